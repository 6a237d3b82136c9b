"""Messages with one field at an extreme, of any type of message."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

from builtin_interfaces.msg import Time

LARGE = (1e154, 1e200, 1.7976931348623157e308)
TINY = (5e-324, 1e-200)
NUMBERS = (-0.0, *TINY, *LARGE, *(-x for x in LARGE), float("nan"), float("inf"), float("-inf"))
WORDS = ("", "x" * 10_000, "\u00fc\n")
_INTEGERS = {"int8": 2**7, "int16": 2**15, "int32": 2**31, "int64": 2**63}
_UNSIGNED = {"uint8": 2**8, "uint16": 2**16, "uint32": 2**32, "uint64": 2**64}


def extremes(message: Any) -> Iterator[tuple[str, Any]]:
    """Copies of a message, each with one field at an extreme, and what was put where."""
    for path, values in _leaves(message, ()):
        for value in values:
            changed = copy.deepcopy(message)
            at = changed
            for step in path[:-1]:
                at = at[step] if isinstance(step, int) else getattr(at, step)
            if isinstance(path[-1], int):
                at[path[-1]] = value
            else:
                setattr(at, path[-1], value)
            shown = repr(value)
            yield f"{'.'.join(map(str, path))} = {shown if len(shown) < 60 else shown[:57] + '...'}", changed


def _leaves(message: Any, above: tuple[Any, ...]) -> Iterator[tuple[tuple[Any, ...], Any]]:
    for name, kind in message.get_fields_and_field_types().items():
        value, path = getattr(message, name), (*above, name)
        base = kind.split("[")[0].removeprefix("sequence<").split(",")[0].removesuffix(">")
        if hasattr(value, "get_fields_and_field_types"):
            yield from _leaves(value, path)
            if isinstance(value, Time):
                yield path, [Time(sec=2**31 - 1, nanosec=2**32 - 1)]
        elif kind.startswith("sequence<") or "[" in kind:
            yield from _items(value, kind, base, path)
        else:
            yield path, _values(base)


def _items(value: Any, kind: str, base: str, path: tuple[Any, ...]) -> Iterator[tuple[tuple[Any, ...], Any]]:
    items = list(value)
    for k in {0, len(items) - 1} & set(range(len(items))):
        if hasattr(items[k], "get_fields_and_field_types"):
            yield from _leaves(items[k], (*path, k))
        else:
            yield (*path, k), _values(base)
    if kind.startswith("sequence<"):
        yield path, [[], items[:-1], items * 2, items * 100] if items else [[]]
        if not items and base in ("double", "float"):
            yield path, [[0.0], [float("nan")] * 3]


def _values(base: str) -> Any:
    if base in ("double", "float"):
        return NUMBERS if base == "double" else [x for x in NUMBERS if x != x or abs(x) in (0, float("inf"))]
    if base == "string":
        return WORDS
    if base == "boolean":
        return (True, False)
    if base in _INTEGERS:
        return (0, _INTEGERS[base] - 1, -_INTEGERS[base])
    if base in _UNSIGNED:
        return (0, _UNSIGNED[base] - 1)
    return ()
