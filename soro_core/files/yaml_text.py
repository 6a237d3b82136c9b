"""YAML text as numbers, texts, lists and mappings of YAML 1.2; numbers that 1.1 reads otherwise are refused.

In YAML 1.1, which PyYAML reads, 01100 is 576, 11:00 is 660, 1_000 is 1000, yes is true and 1.5e3 a text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import yaml
from yaml.resolver import BaseResolver

from soro_core.errors import ConfigError

# SafeLoader: of PyYAML without libyaml.
_Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_DEEPEST = 50
# Values in all, with those that aliases repeat: a file of 500 bytes can name a thousand million.
_MOST_VALUES = 100_000
LONGEST = 16 * 2**20
"""Bytes that a file may have."""

_WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_HEXADECIMAL = re.compile(r"[-+]?0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_ODD = re.compile(
    r"[-+]?0[0-9_]+|[-+]?0o[0-7_]+|[-+]?0b[01_]+"  # leading zeros, octal, binary
    r"|[-+]?[1-9][0-9_]*(:[0-5]?[0-9])+|[-+]?[0-9][0-9_]*(:[0-5]?[0-9])+\.[0-9_]*"  # base 60
    r"|[-+]?0x[0-9a-fA-F_]+|[-+]?(\.[0-9]|[0-9])[0-9_]*(\.[0-9_]*)?([eE][-+]?[0-9_]+)?"  # underscores
)
_WORDS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_ALLOWED = "decimal digits without leading zeros, colons or underscores, or a text in quotes"
_TEXT, _PLAIN = BaseResolver.DEFAULT_SCALAR_TAG, "plain"
_TAGS = {"tag:yaml.org,2002:" + name for name in ("int", "float", "bool", "null")}


class _Loader(_Parser, BaseResolver):  # type: ignore[misc]
    """Parser and composer that tell a plain scalar from a text in quotes."""

    def __init__(self, text: str) -> None:
        _Parser.__init__(self, text)
        BaseResolver.__init__(self)

    def resolve(self, kind: type[yaml.Node], value: str, implicit: Any) -> str:
        if kind is yaml.ScalarNode and implicit[0]:
            return _PLAIN
        return str(super().resolve(kind, value, implicit))  # type: ignore[no-untyped-call]


def read_value(text: str, where: str) -> Any:
    """Read YAML text, of whatever it is; errors name the file `where`.

    Raises
    ------
    ConfigError
        If it is no valid YAML, repeats a key, holds a number that YAML 1.1 and 1.2 read differently or in a
        writing of 1.1 alone, is deeper than 50 levels, or has more than 100000 values, with those that
        aliases repeat.
    """
    try:
        depth = count = 0
        for event in yaml.parse(text, Loader=_Loader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            count += isinstance(event, yaml.NodeEvent)
            _check_size(event, depth, count, where)
        node = yaml.compose(text, Loader=_Loader)
        return None if node is None else _Values(where).of(node, "", 1)
    except (yaml.YAMLError, ValueError) as error:  # a number of ten thousand digits
        if "maximum nesting depth" in str(error):  # libyaml reads ahead, to a limit of its own
            raise ConfigError(where, "", "too many levels", f"{_DEEPEST} levels or fewer") from None
        raise ConfigError(where, "", _reason(error), "valid YAML") from None


class _Values:
    """Values of nodes; each place of an alias is a value of its own."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._count = 0

    def of(self, node: yaml.Node, key: str, depth: int) -> Any:
        """Return the value of a node; `key` is its place, for errors."""
        self._count += 1
        _check_size(node, depth, self._count, self._where)
        if isinstance(node, yaml.SequenceNode):
            self._check_tag(node, key, BaseResolver.DEFAULT_SEQUENCE_TAG)
            return [self.of(item, f"{key}[{k}]", depth + 1) for k, item in enumerate(node.value)]
        if isinstance(node, yaml.MappingNode):
            self._check_tag(node, key, BaseResolver.DEFAULT_MAPPING_TAG)
            return self._mapping(node, key, depth + 1)
        if node.tag == _TEXT:
            return node.value
        if node.tag != _PLAIN and node.tag not in _TAGS:
            self._check_tag(node, key, _TEXT)
        return self._plain(node, key)

    def _mapping(self, node: yaml.MappingNode, key: str, depth: int) -> dict[Any, Any]:
        found: dict[Any, Any] = {}
        merged: dict[Any, Any] = {}
        for name_node, value_node in node.value:
            if name_node.tag == _PLAIN and name_node.value == "<<":
                for part in self._merged(value_node, key, depth):
                    merged = part | merged
                continue
            name = self.of(name_node, key, depth)
            if isinstance(name, list | dict):
                raise ConfigError(self._where, key, _at(name_node, "a key that is no name"), "valid YAML")
            if name in found:
                raise ConfigError(
                    self._where, key, _at(name_node, f"key {name!r} occurs twice"), "valid YAML"
                )
            found[name] = self.of(value_node, f"{key}.{name}" if key else str(name), depth)
        return merged | found

    def _merged(self, node: yaml.Node, key: str, depth: int) -> Iterator[dict[Any, Any]]:
        for part in node.value if isinstance(node, yaml.SequenceNode) else [node]:
            if not isinstance(part, yaml.MappingNode):
                raise ConfigError(self._where, key, _at(part, "<< of no mapping"), "valid YAML")
            yield self.of(part, key, depth)

    def _plain(self, node: yaml.Node, key: str) -> Any:
        text = node.value
        if text in _WORDS:
            return _WORDS[text]
        if _WHOLE.fullmatch(text):
            return int(text)
        if _HEXADECIMAL.fullmatch(text):
            return int(text, 16)
        if _FLOAT.fullmatch(text) and not re.match(r"[-+]?0[0-9]+$", text):
            return float(text)
        if _NOT_FINITE.fullmatch(text):
            return float(text.replace(".", ""))
        if _ODD.fullmatch(text):
            raise ConfigError(self._where, key, text, _ALLOWED)
        return text

    def _check_tag(self, node: yaml.Node, key: str, allowed: str) -> None:
        if node.tag != allowed:
            raise ConfigError(
                self._where, key, _at(node, f"the tag {node.tag!r}"), "valid YAML without such tags"
            )


def _check_size(found: Any, depth: int, count: int, where: str) -> None:
    """Refuse what is too deep, as an alias that holds itself, and what is too much."""
    if depth > _DEEPEST:
        raise ConfigError(where, "", _at(found, "too many levels"), f"{_DEEPEST} levels or fewer")
    if count > _MOST_VALUES:
        allowed = f"{_MOST_VALUES} values or fewer, with those that aliases repeat"
        raise ConfigError(where, "", _at(found, "too many values"), allowed)


def _at(found: Any, text: str) -> str:
    return f"line {found.start_mark.line + 1}, column {found.start_mark.column + 1}: {text}"


def _reason(error: Exception) -> str:
    """Return the place of the first error of the YAML text, and its cause."""
    mark = getattr(error, "problem_mark", None)
    if mark is None:
        return " ".join(str(error).split())
    problem = str(error.problem)  # type: ignore[attr-defined]
    if problem.startswith("but "):
        problem = f"{error.context}, {problem}"  # type: ignore[attr-defined]
    return f"line {mark.line + 1}, column {mark.column + 1}: {problem}"
