"""YAML with a comment at every value."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from soro_lab.scaffold.annotated import Noted

WIDTH = 118


def commented(header: str, tree: Mapping[str, Any]) -> str:
    """Return a file.

    Parameters
    ----------
    header : str
        Comment at the top, with its line breaks.
    tree : mapping
        Of names to `Noted` values, mappings, or lists of mappings.

    Returns
    -------
    str
    """
    top = [line for text in header.splitlines() for line in textwrap.wrap(text, WIDTH - 2) or [""]]
    lines = [f"# {line}".rstrip() for line in top] + _mapping(tree, "")
    return "\n".join(lines) + "\n"


def _mapping(tree: Mapping[str, Any], indent: str) -> list[str]:
    lines: list[str] = []
    for key, node in tree.items():
        if isinstance(node, Noted):
            lines += _value(f"{indent}{key}: {scalar(node.value)}", node.note, indent)
        elif isinstance(node, Mapping):
            lines += [f"{indent}{key}:", *_mapping(node, f"{indent}  ")]
        else:
            lines.append(f"{indent}{key}:")
            lines += [line for item in node for line in _item(item, f"{indent}  ")]
    return lines


def _item(item: Any, indent: str) -> list[str]:
    """Return one entry of a list."""
    if isinstance(item, Noted):
        return _value(f"{indent}- {scalar(item.value)}", item.note, indent)
    lines = _mapping(item, f"{indent}  ")
    first = next(k for k, line in enumerate(lines) if not line.lstrip().startswith("#"))
    dash = len(indent)
    lines[first] = f"{lines[first][:dash]}-{lines[first][dash + 1 :]}"
    return lines


def _value(line: str, note: str, indent: str) -> list[str]:
    """Return a line with its comment behind it, or above it where that is too long."""
    if not note:
        return [line]
    behind = f"{line}  # {note}"
    if len(behind) <= WIDTH:
        return [behind]
    return [*(f"{indent}# {part}" for part in textwrap.wrap(note, WIDTH - len(indent) - 2)), line]


def scalar(value: Any) -> str:
    """Return a value as YAML in one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {scalar(each)}" for key, each in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(scalar, value)) + "]"
    return "null" if value is None else str(value)


def _number(value: float) -> str:
    """Return a float that YAML 1.1 and 1.2 both read as one."""
    text = f"{value:.12g}"
    mantissa, e, exponent = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return mantissa + e + exponent
