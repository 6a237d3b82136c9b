"""The command line of a process of nodes: ROS arguments, nothing else, and a short help."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import pairwise, takewhile
from typing import NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.utilities import remove_ros_args

from soro_core.config import Strict
from soro_core.errors import ConfigError
from soro_ros.host import middleware
from soro_ros.process import parameters
from soro_ros.process.parameter_files import read_file

# Errors of rcl about arguments.
ARGUMENT_ERRORS = (rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError)

_ROS = "[--ros-args [-p NAME:=VALUE]... [--params-file FILE]... [-r __ns:=/NAMESPACE]]"


class Program(NamedTuple):
    """What the command line of a process says of itself.

    Attributes
    ----------
    name : str
        As errors name it.
    command : str
        As it is typed, ``soro_twin``.
    help : str
        Lines below the usage.
    """

    name: str
    command: str
    help: str


def of_node(name: str, model: type[Strict]) -> Program:
    """Return the program of one node, which lists its parameters."""
    described = parameters.described(model)
    lines = [f"  {key} [{default!r}]: {text}" for key, default, text in described]
    return Program(name, f"soro_{name}", "\n".join(["parameters:", *lines]))


def asks_for_help(given: Sequence[str]) -> bool:
    """Whether the arguments of the program itself ask for help."""
    return bool({"-h", "--help"} & set(own(given)))


def own(given: Sequence[str]) -> list[str]:
    """Return the arguments before those of ROS."""
    return list(given[: given.index("--ros-args")] if "--ros-args" in given else given)


def namespaces(given: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the namespaces of several arms, which stand before all other arguments, and the rest."""
    found = list(takewhile(lambda one: one.startswith("/"), given))
    return found, list(given[len(found) :])


def initialise(program: Program, args: list[str] | None = None) -> None:
    """Join ROS with these arguments, by default those of the process; `--help` ends it.

    Raises
    ------
    ConfigError
        If an argument or a parameter file cannot be understood.
    """
    given = sys.argv[1:] if args is None else args
    if asks_for_help(given):
        print(f"usage: {program.command} {_ROS}\n\n{program.help}")
        raise SystemExit(0)
    where = f"command line of {program.name}"
    read_file.cache_clear()
    for option, file in pairwise(given):
        if option == "--params-file":
            read_file(file)  # its errors are clearer than those of ROS
    try:
        middleware.init(given)
        unknown = remove_ros_args(given)
    except ARGUMENT_ERRORS as error:
        text = " ".join(str(error).removeprefix("failed to initialize rcl: ").split())
        raise ConfigError(where, "", text.split(", at /")[0].rstrip(" ,"), _allowed(program)) from None
    if unknown:
        raise ConfigError(where, "", " ".join(unknown), _allowed(program))


def _allowed(program: Program) -> str:
    return f"ROS arguments, for example --ros-args -p rate_hz:=100.0; see {program.command} --help"
