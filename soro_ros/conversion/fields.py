"""Messages as named values: each number and text of a message by its dotted path, and back."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from builtin_interfaces.msg import Duration, Time
from sensor_msgs.msg import JointState

from soro_core.files.csv_rows import number_of
from soro_ros.conversion.interfaces import message_class

Value: TypeAlias = float | int | str

_VARIABLE = re.compile(r"sequence<(.+?)(?:, \d+)?>")
_FIXED = re.compile(r"(.+)\[\d+\]")
_TIME_TYPES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
# Sequences of a JointState whose elements have the names of its joints.
NAMED = ("position", "velocity", "effort")


def flat(message: Any, by_name: bool = True) -> dict[str, Value]:
    """Return every value of a message by its path; `by_name` leaves out the numbers in a JointState.

    A time is one number of nanoseconds. An element of a sequence has its number in the path, one of a
    JointState the name of its joint: ``header.stamp_ns``, ``pose.covariance.7``, ``effort.link0/chamber1``.
    """
    names = list(message.name) if by_name and is_joint_state(message) else []
    return dict(_leaves(message, "", names))


def is_joint_state(message: Any) -> bool:
    """Whether the elements of a message's sequences have the names in its field `name`."""
    return isinstance(message, JointState) or (
        _type_of(message) == "sensor_msgs/msg/JointState"
        and all(hasattr(getattr(message, field, None), "__len__") for field in ("name", *NAMED))
    )


def _type_of(message: Any) -> str:
    """Return the type of a message that was read by the definition in its bag; "" of others."""
    return str(getattr(message, "__msgtype__", ""))


def _leaves(value: Any, path: str, names: list[str]) -> Iterator[tuple[str, Value]]:
    if isinstance(value, Time | Duration) or _type_of(value) in _TIME_TYPES:
        yield f"{path}_ns", value.sec * 10**9 + value.nanosec
    elif hasattr(value, "get_fields_and_field_types") or _type_of(value):
        for field in value.get_fields_and_field_types() if not _type_of(value) else vars(value):
            yield from _leaves(getattr(value, field), f"{path}.{field}" if path else field, names)
    elif isinstance(value, str):
        yield path, value
    elif isinstance(value, bytes):  # one byte
        yield path, int.from_bytes(value, "little")
    elif hasattr(value, "__len__"):
        named = names if len(names) == len(value) and path != "name" else range(len(value))
        for name, item in zip(named, value, strict=True):
            yield from _leaves(item, f"{path}.{name}", [])
    else:
        yield path, value.item() if hasattr(value, "item") else value


def built(kind: type[Any], values: Mapping[str, str], names: Sequence[str] = (), delimiter: str = ",") -> Any:
    """Return the message of some values, the others by default; the inverse of `flat`.

    Parameters
    ----------
    kind : type
        Class of the message.
    values : mapping of str to str
        Texts by path.
    names : sequence of str
        Names in the paths of a JointState that has a value.
    delimiter : str
        What divides the texts in their file, by which decimal commas are judged (`number_of`).

    Raises
    ------
    KeyError
        With the path that the message does not have.
    ValueError
        With path, text and what is allowed.
    """
    message = kind()
    if names and values:
        message.name = list(names)
    places = {name: str(k) for k, name in enumerate(names)}
    tree: dict[str, Any] = {}
    for path, text in values.items():
        field, _, rest = path.partition(".")
        keys = [field, places[rest]] if rest in places else path.split(".")
        branch = tree
        for key in keys[:-1]:
            branch = branch.setdefault(key, {})
            if not isinstance(branch, dict):
                raise KeyError(path)
        branch[keys[-1]] = text
    _fill(message, tree, "", delimiter)
    return message


def _fill(message: Any, tree: Mapping[str, Any], path: str, delimiter: str) -> None:
    types = message.get_fields_and_field_types()
    for key, part in tree.items():
        at = f"{path}.{key}" if path else key
        if key.endswith("_ns") and types.get(key[:-3]) in (
            "builtin_interfaces/Time",
            "builtin_interfaces/Duration",
        ):
            seconds, nanoseconds = divmod(_parsed("int64", part, at, delimiter), 10**9)
            kind = type(getattr(message, key[:-3]))
            setattr(message, key[:-3], kind(sec=seconds, nanosec=nanoseconds))
        elif key not in types:
            raise KeyError(at)
        else:
            setattr(message, key, _value(types[key], getattr(message, key), part, at, delimiter))


def _value(type_name: str, default: Any, part: Any, path: str, delimiter: str) -> Any:
    variable, fixed = _VARIABLE.fullmatch(type_name), _FIXED.fullmatch(type_name)
    found = variable or fixed
    if found is None:
        if "/" not in type_name:
            return _parsed(type_name, part, path, delimiter)
        if not isinstance(part, dict):
            raise KeyError(path)
        _fill(default, part, path, delimiter)
        return default
    if not isinstance(part, dict) or not all(key.isdigit() for key in part):
        raise KeyError(path)
    items = [] if variable else list(default)
    for number in sorted(map(int, part)):
        if number > len(items) or (fixed and number >= len(items)):
            raise ValueError(f"{path}.{number} after {len(items)} elements: a gap, or one too many")
        if number == len(items):
            items.append(_empty(found[1]))
        items[number] = _value(found[1], items[number], part[str(number)], f"{path}.{number}", delimiter)
    return items


def _empty(type_name: str) -> Any:
    kind = message_class(type_name.replace("/", "/msg/")) if "/" in type_name else None
    return None if kind is None else kind()


def _parsed(type_name: str, part: Any, path: str, delimiter: str) -> Any:
    if not isinstance(part, str):
        raise KeyError(path)
    try:
        if type_name.startswith(("string", "wstring")):
            return part
        if type_name in ("float", "double"):
            return number_of(part, delimiter)
        if type_name == "boolean":
            return {"true": True, "false": False}[part.lower()]
        if type_name == "octet":
            return bytes([int(part)])
        return int(part)
    except (ValueError, KeyError):
        raise ValueError(f"{path}: {part!r:.60} is no {type_name}") from None
