"""Fields of the classes on the page of the library: their texts, and links to the pages of keys."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator

from pydantic import BaseModel
from sphinx.pycode import ModuleAnalyzer

from reference.keys import target

_SECTION = re.compile(r"^(?:Attributes|Parameters)\n-+\n(.*?)(?:\n\n|\Z)", re.M | re.S)
_ENTRY = re.compile(r"^([\w*, ]+?)(?: : .*)?\n +\S", re.M)
_SEVERAL = re.compile(r":(ivar|vartype) ([\w\\*, ]+,[\w\\*, ]+):(.*)")


def undescribed(thing: type) -> list[str]:
    """Return the fields of a data class, named tuple or model for which the page would have no text."""
    return [name for name in _names(thing) if name not in set(_described(thing))]


def show(linked: list[type], what: str, thing: object, lines: list[str]) -> None:
    """Add to a docstring the fields of a model, and a link to the page that has them as keys.

    Parameters
    ----------
    linked : list of type
        Models whose tables can be linked.
    what : str
        Kind of the thing.
    thing : object
        What is documented.
    lines : list of str
        Its docstring, changed in place.
    """
    lines[:] = [new for line in _entries(lines) for new in _split(line)]
    if what != "class" or not (isinstance(thing, type) and issubclass(thing, BaseModel)):
        return
    texts = ((name, one.description) for name, one in thing.model_fields.items() if one.description)
    lines += ["", *(f":ivar {name}: {text}".replace("|", r"\|") for name, text in texts), ""]
    model = next((one for one in linked if issubclass(one, thing)), None)
    if model is not None and thing.model_fields:
        lines += [f".. seealso:: :ref:`The keys in files <{target(model)}>`", ""]


def is_alias(what: str, thing: object) -> bool:
    """Whether a member only repeats the number of a field in a named tuple."""
    return what == "class" and (inspect.getdoc(thing) or "").startswith("Alias for field number")


def _names(thing: type) -> list[str]:
    if issubclass(thing, BaseModel):
        return list(thing.model_fields)
    if dataclasses.is_dataclass(thing):
        return [one.name for one in dataclasses.fields(thing) if not one.name.startswith("_")]
    return list(getattr(thing, "_fields", ()))


def _described(thing: type) -> Iterator[str]:
    if issubclass(thing, BaseModel):
        yield from (name for name, one in thing.model_fields.items() if one.description)
    for one in thing.__mro__:
        for section in _SECTION.findall(inspect.cleandoc(one.__doc__ or "")):
            yield from (name for names in _ENTRY.findall(section + "\n") for name in names.split(", "))
        # The members of a named tuple are not shown.
        if dataclasses.is_dataclass(one):
            documented = ModuleAnalyzer.for_module(one.__module__).find_attr_docs()
            yield from (name for owner, name in documented if owner == one.__qualname__)


def _entries(lines: list[str]) -> Iterator[list[str]]:
    """Yield each line; an entry of several names with the lines that belong to it."""
    entry: list[str] = []
    for line in lines:
        if entry and line.startswith(" "):
            entry.append(line)
            continue
        if entry:
            yield entry
        entry = [line]
    if entry:
        yield entry


def _split(entry: list[str]) -> list[str]:
    """Return an entry of several names, which napoleon leaves whole, as one for each."""
    found = _SEVERAL.fullmatch(entry[0])
    if found is None:
        return entry
    kind, names, text = found.groups()
    return [line for name in names.split(",") for line in (f":{kind} {name.strip()}:{text}", *entry[1:])]
