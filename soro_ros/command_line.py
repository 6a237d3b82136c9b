"""The command line of a node: ROS arguments, nothing else, and a short help."""

from __future__ import annotations

import sys
from itertools import pairwise
from typing import Protocol

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.utilities import remove_ros_args

from soro_core.config import Strict, read_yaml
from soro_core.errors import ConfigError
from soro_ros import middleware, parameters

# Errors of rcl about arguments.
ARGUMENT_ERRORS = (rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError)

_USAGE = "usage: soro_{name} [--ros-args [-p NAME:=VALUE]... [--params-file FILE]... [-r __ns:=/NAMESPACE]]"


class _Described(Protocol):
    node_name: str
    config_model: type[Strict]


def initialise(node: _Described, args: list[str] | None = None) -> None:
    """Join ROS with these arguments, by default those of the process; `--help` ends it.

    Raises
    ------
    ConfigError
        If an argument or a parameter file cannot be understood.
    """
    given = sys.argv[1:] if args is None else args
    own = given[: given.index("--ros-args")] if "--ros-args" in given else given
    if {"-h", "--help"} & set(own):
        print(_help(node))
        raise SystemExit(0)
    where = f"command line of {node.node_name}"
    for option, file in pairwise(given):
        if option == "--params-file":
            read_yaml(file)  # its errors are clearer than those of ROS
    try:
        middleware.init(given)
        unknown = remove_ros_args(given)
    except ARGUMENT_ERRORS as error:
        text = " ".join(str(error).removeprefix("failed to initialize rcl: ").split())
        raise ConfigError(where, "", text.split(", at /")[0].rstrip(" ,"), _allowed(node)) from None
    if unknown:
        raise ConfigError(where, "", " ".join(unknown), _allowed(node))


def _allowed(node: _Described) -> str:
    return f"ROS arguments, for example --ros-args -p rate_hz:=100.0; see soro_{node.node_name} --help"


def _help(node: _Described) -> str:
    lines = [_USAGE.format(name=node.node_name), "", "parameters:"]
    for name, default, text in parameters.described(node.config_model):
        lines.append(f"  {name} [{default!r}]: {text}")
    return "\n".join(lines)
