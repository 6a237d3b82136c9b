"""Frozen dataclasses for states that change with each tick: made, also with other values, in less time."""

from __future__ import annotations

from dataclasses import fields
from functools import update_wrapper
from typing import Any, TypeVar

Frozen = TypeVar("Frozen")


def quick(made: type[Frozen]) -> type[Frozen]:
    """Let a frozen dataclass fill its objects in a third of the time, past the lock of its fields.

    Parameters
    ----------
    made : dataclass
        Of a class without slots, `__post_init__` and default factories.
    """
    names = [field.name for field in fields(made)]  # type: ignore[arg-type]
    lines = [f"def fill(self, {', '.join(names)}):", " _made = self.__dict__"]
    scope: dict[str, Any] = {}
    exec("\n".join(lines + [f" _made[{name!r}] = {name}" for name in names]), scope)
    fill = scope["fill"]
    fill.__defaults__ = made.__init__.__defaults__
    made.__init__ = update_wrapper(fill, made.__init__)  # type: ignore[method-assign]
    return made


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
