"""Messages as named values: each number and text of a message by its dotted path."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

from sensor_msgs.msg import JointState

Value: TypeAlias = float | int | str


def flat(message: Any) -> dict[str, Value]:
    """Return every value of a message by its path.

    An element of a sequence has its number in the path, one of a JointState the name of its joint:
    ``pose.pose.position.x``, ``pose.covariance.7``, ``effort.link0/chamber1``.
    """
    names = list(message.name) if isinstance(message, JointState) else []
    return dict(_leaves(message, "", names))


def _leaves(value: Any, path: str, names: list[str]) -> Iterator[tuple[str, Value]]:
    if hasattr(value, "get_fields_and_field_types"):
        for field in value.get_fields_and_field_types():
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
