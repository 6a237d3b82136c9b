"""What other packages offer by name: entry points of a group, beside the names that soro brings."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from soro_core.errors import nearest


def names_of(group: str, shipped: Iterable[str]) -> tuple[str, ...]:
    """Return the shipped names, then those of other packages in the group."""
    own = tuple(shipped)
    return (*own, *sorted({entry.name for entry in entry_points(group=group)} - set(own)))


def load(group: str, shipped: Iterable[str], name: str, is_one: Callable[[Any], bool], one: str) -> Any:
    """Load what another package offers.

    Parameters
    ----------
    group, name : str
        Group of the entry point, and its name.
    shipped : iterable of str
        Names that are no entry points.
    is_one : callable
        Whether an object is of the kind that the group has.
    one : str
        That kind, for errors.

    Raises
    ------
    ValueError
        If there is none of this name, or its package does not load; the text says what is allowed.
    """
    names, found = names_of(group, shipped), tuple(entry_points(group=group, name=name))
    if not found:
        raise ValueError(f"one of {', '.join(names)}{nearest(name, names)}")
    others, value = ", ".join(other for other in names if other != name), found[0].value
    try:
        loaded = found[0].load()
    except (Exception, SystemExit) as error:  # whatever another package does when it is imported
        raise ValueError(f"{others}; {value} does not load ({told(error, value)})") from None
    if not is_one(loaded):
        raise ValueError(f"{others}; {value} is no {one}")
    return loaded


def told(error: BaseException, of: str) -> str:
    """Return an error in one line, with the last line of code from outside on the way to it.

    Parameters
    ----------
    error : BaseException
    of : str
        That code: a file, or a module, all of whose package counts.
    """
    package, place = of.partition(":")[0].partition(".")[0], ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        file, module = frame.f_code.co_filename, str(frame.f_globals.get("__name__", ""))
        if file == of or module.partition(".")[0] == package:
            place = f" ({Path(file).name}, line {line})"
    return " ".join(f"{type(error).__name__}: {error}".split()) + place
