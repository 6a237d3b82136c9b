"""The nodes of one arm in one process, with one executor."""

from __future__ import annotations

import sys
from itertools import pairwise

from soro_core.errors import ConfigError
from soro_ros import command_line
from soro_ros.command_line import Program
from soro_ros.lifecycle import SoroNode
from soro_ros.node_process import run_nodes
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.regulator import RegulatorNode
from soro_ros.nodes.twin import TwinNode

# In the order of their start; the last one of a process drives the valves.
NODES: dict[str, type[SoroNode]] = {
    node.node_name: node for node in (EstimatorNode, ControllerNode, TwinNode, RegulatorNode)
}
DEFAULT = ("estimator", "controller", "twin")
PROGRAM = Program(
    "arm",
    f"soro_arm [{'|'.join(NODES)}]...",
    f"Without names: {', '.join(DEFAULT)}. The parameters are those of the nodes, as soro_twin --help lists "
    "them.\nA parameter of one node: -p twin:payload_kg:=0.02",
)


def chosen(arguments: list[str]) -> tuple[list[type[SoroNode]], list[str]]:
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
    for option, value in pairwise(arguments):
        key = value.partition(":=")[0]
        node = key.rpartition(":")[0].rpartition("/")[2]
        if option in ("-p", "--param") and node not in ("", "*", "**", *wanted):
            raise ConfigError("command line of arm", option, value, f"for one of {', '.join(wanted)}")
    return [node for name, node in NODES.items() if name in wanted], arguments[len(names) :]


def main() -> None:
    """Entry point of `ros2 run soro_ros arm`."""
    try:
        nodes, rest = chosen(sys.argv[1:])
    except ConfigError as error:
        sys.stderr.write(f"arm: {error}\n")
        raise SystemExit(2) from None
    run_nodes(nodes, PROGRAM, rest)


if __name__ == "__main__":
    main()
