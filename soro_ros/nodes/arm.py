"""The nodes of one arm in one process, with one executor."""

from __future__ import annotations

import contextlib
import sys
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from soro_core.errors import ConfigError
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.regulator import RegulatorNode
from soro_ros.nodes.twin import TwinNode
from soro_ros.process import command_line
from soro_ros.process.command_line import Program
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_nodes

# In the order of their start; the last one of a process drives the valves.
NODES: dict[str, type[SoroNode[Any]]] = {
    node.node_name: node for node in (EstimatorNode, ControllerNode, TwinNode, RegulatorNode)
}
DEFAULT = ("estimator", "controller", "twin")
PROGRAM = Program(
    "arm",
    f"soro_arm [{'|'.join(NODES)}]...",
    f"Without names: {', '.join(DEFAULT)}. The parameters are those of the nodes, as soro_twin --help lists "
    "them.\nA parameter of one node: -p twin:payload_kg:=0.02",
)


def chosen(arguments: list[str]) -> tuple[list[type[SoroNode[Any]]], list[str]]:
    """Return the nodes that a command line names, in the order of their start, and the rest of it.

    Raises
    ------
    ConfigError
        If a name is not one of a node of an arm, or a parameter is for a node that is not chosen.
    """
    names = [name for name in command_line.own(arguments) if not name.startswith("-")]
    if unknown := [name for name in names if name not in NODES]:
        raise ConfigError("command line of arm", "", " ".join(unknown), ", ".join(NODES))
    wanted = names or DEFAULT
    for option, rule in pairwise(arguments):
        node = _rule_of(option, rule)[0]
        if node not in ("", *wanted):
            raise ConfigError("command line of arm", option, rule, f"for one of {', '.join(wanted)}")
    return [node for name, node in NODES.items() if name in wanted], arguments[len(names) :]


@contextlib.contextmanager
def for_any_namespace(arguments: list[str]) -> Iterator[list[str]]:
    """Give ROS arguments in which ``-p NODE:KEY:=VALUE`` counts for that node in whatever namespace.

    ROS ignores such a rule, without a word, for a node in a namespace; an entry of a parameter file counts.
    """
    own = [_rule_of(option, rule) for option, rule in pairwise(arguments)]
    entries = [f"/**/{node}:\n  ros__parameters:\n    {key}: {value}\n" for node, key, value in own if node]
    with tempfile.TemporaryDirectory(prefix="soro-") as folder:
        files: list[str] = []
        for k, entry in enumerate(entries):  # one each: a node may have several
            file = Path(folder) / f"{k}.yaml"
            file.write_text(entry, encoding="utf-8")
            files += ["--params-file", str(file)]
        yield [*arguments, *files]


def _rule_of(option: str, rule: str) -> tuple[str, str, str]:
    """Return node, key and value of a rule for one node; empty for another argument."""
    name, _, value = rule.partition(":=")
    node, _, key = name.rpartition(":")
    return (node, key, value) if option in ("-p", "--param") else ("", "", "")


def main() -> None:
    """Entry point of `ros2 run soro_ros arm`."""
    try:
        nodes, rest = chosen(sys.argv[1:])
    except ConfigError as error:
        sys.stderr.write(f"arm: {error}\n")
        raise SystemExit(2) from None
    with for_any_namespace(rest) as arguments:
        run_nodes(nodes, PROGRAM, arguments)


if __name__ == "__main__":
    main()
