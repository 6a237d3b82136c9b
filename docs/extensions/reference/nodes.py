"""Parameters, topics and services of the nodes: those of running nodes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from reference.tables import code, plain, table
from soro_ros.process.parameters import described

INTERFACES = Path(__file__).with_name("interfaces.py")
HEAD = ("topic", "type", "quality of service, depth")


def pages() -> dict[str, tuple[str, str, str]]:
    """Return the pages of parameters and topics."""
    from reference.interfaces import node_classes

    # The nodes run in a process of their own: without compiled kernels they are there at once.
    surroundings = {**os.environ, "NUMBA_DISABLE_JIT": "1", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    asked = subprocess.run(
        [sys.executable, INTERFACES], env=surroundings, capture_output=True, text=True, check=False
    )
    if asked.returncode:
        raise RuntimeError(f"{INTERFACES.name} failed:\n{asked.stderr}")
    found = json.loads(asked.stdout.splitlines()[-1])
    parameters = "\n".join(_parameters(node) for node in node_classes().values())
    topics = "\n".join(_topics(name, topics) for name, topics in found.items())
    about = "Parameters of each node, `soro_NAME --ros-args -p PARAMETER:=VALUE`, with default and meaning."
    seen = (
        "Topics and services of each node in real time with its default parameters, in the namespace of the "
        "arm; ~ is the name of the node. Each node also publishes /diagnostics."
    )
    return {"parameters": ("Parameters", about, parameters), "topics": ("Topics and services", seen, topics)}


def _parameters(node: type) -> str:
    rows = [
        (
            code(name),
            "yes" if name.startswith(node.live) and node.live else "",
            code(repr(default)),
            plain(text),
        )
        for name, default, text in described(node.config_model)
    ]
    return f"## {node.node_name}\n\n{table(('parameter', 'acts at once', 'default', 'meaning'), rows)}"


def _topics(name: str, found: dict[str, list[list[str]]]) -> str:
    text = f"## {name}\n\n"
    for title in ("publishes", "subscribes to", "serves"):
        rows = [tuple(code(cell) for cell in row[:2]) + tuple(row[2:]) for row in found[title]]
        head = HEAD if title != "serves" else ("service", "type")
        text += table((f"{title}: {head[0]}", *head[1:]), rows)
    return text
