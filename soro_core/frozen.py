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
    fields = before.__dict__
    if not changes.keys() <= fields.keys():
        raise TypeError(f"{type(before).__name__} has no field {', '.join(changes.keys() - fields.keys())}")
    after = object.__new__(type(before))
    after.__dict__.update(fields)
    after.__dict__.update(changes)
    return after
