"""What a parameter says of itself, and values as they come: whole numbers, texts of numbers, empty lists."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from soro_core.errors import ConfigError
from soro_core.files.yaml_text import read_value

# What the bounds of a field are called; lengths are those of lists.
_BOUNDS = {
    "gt": "above",
    "ge": "at least",
    "lt": "below",
    "le": "at most",
    "min_length": "entries: at least",
    "max_length": "entries: at most",
}
# What tools write for a parameter that is not set.
_NOTHING = ("None", "null", "~")
# Only the start of a process reads them.
READ_ONLY = ("autostart", "end_on_failed_start", "priority")


def described_field(field: FieldInfo) -> str:
    """Return the description of a field with its bounds and choices, as plain text."""
    found = [
        f"{text} {bound:g}" if isinstance(bound, float) else f"{text} {bound}"
        for text, bound in ((text, _bound(field, name)) for name, text in _BOUNDS.items())
        if bound is not None
    ]
    if choices := _choices(field):
        found.append(f"one of {', '.join(choices)}")
    text = (field.description or "").replace("`", "")
    return f"{text} ({', '.join(found)})" if found else text


def descriptor(name: str, field: FieldInfo) -> ParameterDescriptor:
    """Return what `ros2 param describe` and graphical tools show of a parameter, with its range."""
    # The model checks types: it accepts 200 for a float, a typed parameter does not.
    found = ParameterDescriptor(
        description=described_field(field),
        additional_constraints=", ".join(_choices(field)),
        read_only=name in READ_ONLY,
        dynamic_typing=True,
    )
    kinds = set(_kinds(field.annotation))
    low = next((bound for key in ("ge", "gt") if (bound := _bound(field, key)) is not None), None)
    high = next((bound for key in ("le", "lt") if (bound := _bound(field, key)) is not None), None)
    if (low is None and high is None) or _is_list(field):
        return found
    if float in kinds:
        most = sys.float_info.max
        low, high = (-most if low is None else float(low)), (most if high is None else float(high))
        found.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif int in kinds:
        low, high = (-(2**63) if low is None else int(low)), (2**63 - 1 if high is None else int(high))
        found.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return found


def as_given(field: FieldInfo | None, value: Any) -> Any:
    """Return a value with the type of its field, where it has the meaning of one.

    `ros2 param set` and `ros2 param load` send 1e-07 as a text, lists of such numbers too, and what is not
    set as ``None``. What has no meaning for the field stays as it is: the model refuses it.

    Parameters
    ----------
    field : FieldInfo or None
        Field of the configuration model; None for a key of a mapping, which takes anything.
    value : object
        Value of the parameter.
    """
    if hasattr(value, "tolist") or isinstance(value, tuple):
        value = list(value)
    kinds = {str} if field is None else set(_kinds(field.annotation))
    takes_text = str in kinds and field is not None
    if isinstance(value, str) and not takes_text:
        value = None if value in _NOTHING and type(None) in kinds else _number(value)
    if float in kinds and int not in kinds:
        value = [_whole(one) for one in value] if isinstance(value, list) else _whole(value)
    return value


def _number(text: str) -> Any:
    """Return the number or the list that a text is, or the text."""
    try:
        found = read_value(text, where="")
    except ConfigError:
        return text
    is_list = isinstance(found, list) and all(isinstance(one, int | float) for one in found)
    return found if is_list or isinstance(found, int | float) else text


def _whole(value: Any) -> Any:
    return float(value) if type(value) is int else value


def _bound(field: FieldInfo, name: str) -> Any:
    return next((getattr(item, name) for item in field.metadata if hasattr(item, name)), None)


def _is_list(field: FieldInfo) -> bool:
    return any(get_origin(one) is tuple for one in _parts(field.annotation))


def _choices(field: FieldInfo) -> list[str]:
    return [
        str(one) for part in _parts(field.annotation) if get_origin(part) is Literal for one in get_args(part)
    ]


def _kinds(annotation: Any) -> Iterator[Any]:
    """Yield the types of single values that an annotation allows; str for a choice of words."""
    for part in _parts(annotation):
        if get_origin(part) is Literal:
            yield from (type(one) for one in get_args(part))
        elif get_origin(part) is None:
            yield part


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield an annotation and what it is made of, but for the words of a choice."""
    yield annotation
    if get_origin(annotation) is not Literal:
        inner: Iterable[Any] = get_args(annotation)
        for part in inner:
            yield from _parts(part)
