"""Which parameters were given to a node by its name, and which to every node by a wildcard."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import Any

from soro_core.config import read_yaml

_KEYS = "ros__parameters"
# Options of the command line: a file, and one parameter, which may name its node.
_FILE, _VALUE = ("--params-file",), ("-p", "--param")


@cache
def read_file(file: str) -> dict[str, Any]:
    """Read a parameter file at the start of a process, as ROS does."""
    return read_yaml(file)


def given_by_name(arguments: Sequence[str], node: str) -> set[str]:
    """Return the parameters that a command line gives to a node by its own name, in its files too.

    A file may have an entry for many nodes, as ``/**``, which no node can be expected to know in full.
    What an entry of the node's own name or the command line says is meant for it.

    Returns
    -------
    set of str
        Names of parameters.
    """
    names: set[str] = set()
    for option, value in pairwise(arguments):
        if option in _VALUE:
            names.add(value.partition(":=")[0].rpartition(":")[2])
        elif option in _FILE:
            for path, keys in _entries(read_file(value)):
                if path.rpartition("/")[2] == node:
                    names |= set(flattened(keys))
    return names


def flattened(values: Mapping[str, Any]) -> dict[str, Any]:
    """Flatten nested mappings to ``{"a.b": value}``; tuples become lists."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat.update({f"{name}.{key}": inner for key, inner in flattened(value).items()})
        else:
            flat[name] = list(value) if isinstance(value, tuple) else value
    return flat


def _entries(tree: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the parameters of each entry of a file with the name of its nodes; namespaces may be nested."""
    for name, inner in tree.items():
        if not isinstance(inner, Mapping):
            continue
        if name == _KEYS:
            yield path, inner
        else:
            yield from _entries(inner, f"{path}/{name}")
