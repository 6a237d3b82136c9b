"""Keys of scene, robot, part, task and platform files: from the models that check the files."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from reference.tables import code, plain, table
from soro_core.control.laws.registry import SHIPPED, find_law
from soro_core.robot import Robot
from soro_design.parts.file import PartFile
from soro_design.topology.task import Task
from soro_hardware.families import FAMILIES
from soro_lab.scene import Scene
from soro_ros.process.parameter_values import described_field

# Units by the end of a name, where the description does not state one in brackets.
UNITS = {
    "pa_s": "Pa/s", "m_s2": "m/s^2", "m_s": "m/s", "rad_s": "rad/s", "per_m": "1/m", "pa": "Pa", "kpa": "kPa",
    "hz": "Hz", "rad": "rad", "deg": "deg", "kg": "kg", "mm": "mm", "ns": "ns", "ms": "ms", "m": "m",
    "s": "s",
}  # fmt: skip
_BRACKETS = re.compile(r"\[([^\]]*)\]")
_HEAD = ("key", "default", "unit", "allowed", "meaning")


def pages(linked: list[type[BaseModel]]) -> dict[str, tuple[str, str, str]]:
    """Return the pages of the keys.

    Parameters
    ----------
    linked : list of type of BaseModel
        Gets the models whose tables can be linked, see `target`.
    """
    about = "Every key of a {} file with its default, unit and what is allowed; another key is refused."
    families = {name: family.find(family.config) for name, family in FAMILIES.items()}
    platforms = "\n".join(
        f"## family: {name}\n\n{sections(model, '', 3, linked)}" for name, model in families.items()
    )
    laws = "\n".join(
        sections(find_law(name).Options, f"controller.law_options (law: {name})", 2, linked)
        for name in SHIPPED
    )
    return {
        "scene_keys": ("Keys of a scene", about.format("scene"), sections(Scene, "", 2, linked) + laws),
        "robot_keys": ("Keys of a robot", about.format("robot"), sections(Robot, "", 2, linked)),
        "task_keys": (
            "Keys of a design task",
            about.format("task"),
            sections(Task, "", 2, linked),
        ),
        "part_keys": ("Keys of a part", about.format("part"), sections(PartFile, "", 2, linked)),
        "platform_keys": ("Keys of a platform", about.format("platform"), platforms),
    }


def target(model: type[BaseModel]) -> str:
    """Return the name of the place of a model's table, for links."""
    return f"keys-{model.__module__}.{model.__qualname__}".lower()


def sections(
    model: type[BaseModel],
    path: str,
    level: int,
    linked: list[type[BaseModel]],
    shown: dict[type[BaseModel], str] | None = None,
) -> str:
    """Return the table of a model, and after it those of the models that its keys hold.

    A model that stands at several places has its table at the first one.

    Parameters
    ----------
    model : type of BaseModel
    path : str
        Keys that lead to it; empty for the file itself.
    level : int
        Level of the headings.
    linked : list of type of BaseModel
        Models that have a table on any page, which gets this one.
    shown : dict, optional
        Models that have their table in this file, and where.
    """
    shown = {} if shown is None else shown
    found, own = [], []
    if model not in linked:
        linked.append(model)
        found.append(f"({target(model)})=\n")
    if path:
        found.append(f"{'#' * level} {path}\n")
    if model in shown:
        return "\n".join([*found, f"The keys of {plain(shown[model])}.\n"])
    shown[model] = path
    found.append(plain(inspect.getdoc(model).split("\n\n")[0]) + "\n")  # type: ignore[union-attr]
    rows = []
    for name, field in model.model_fields.items():
        inner = list(dict.fromkeys(_models(field.annotation)))
        rows.append((code(name), _default(field), *_cells(name, field)))
        own += [(one, f"{path}.{name}".lstrip(".") + _mark(field.annotation), len(inner)) for one in inner]
    found.append(table(_HEAD, rows))
    for one, place, many in own:
        found.append(sections(one, place + (f" ({_kind(one)})" if many > 1 else ""), level, linked, shown))
    return "\n".join(found)


def _cells(name: str, field: FieldInfo) -> tuple[str, str, str]:
    """Unit, allowed values and meaning of a key."""
    text = (field.description or "").replace("`", "")
    allowed = described_field(field).removeprefix(text).strip().removeprefix("(").removesuffix(")")
    stated = _BRACKETS.search(text)
    unit = stated[1] if stated else next((u for end, u in UNITS.items() if name.endswith(f"_{end}")), "")
    return plain(unit), plain(allowed or _type(field.annotation)), plain(text)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    value = field.get_default(call_default_factory=True)
    if isinstance(value, BaseModel) or (isinstance(value, Mapping) and any(_models(field.annotation))):
        return "below"
    if value is None or value in ((), "", {}):
        return "none"
    return code(list(value) if isinstance(value, tuple) else value)


def _bare(annotation: Any) -> Any:
    return _bare(get_args(annotation)[0]) if get_origin(annotation) is Annotated else annotation


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models that a key can hold."""
    annotation = _bare(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    else:
        for one in get_args(annotation):
            yield from _models(one)


def _mark(annotation: Any) -> str:
    """What stands behind the name of a key that holds several: a list, or a mapping by name."""
    origins = {get_origin(_bare(one)) for one in (annotation, *get_args(_bare(annotation)))}
    return "[]" if origins & {tuple, list} else ".NAME" if dict in origins else ""


def _kind(model: type[BaseModel]) -> str:
    """What tells a model from others at its place: its only literal, or its name."""
    literals = (
        (name, get_args(field.annotation))
        for name, field in model.model_fields.items()
        if get_origin(field.annotation) is Literal
    )
    return next((f"{name}: {choices[0]}" for name, choices in literals if len(choices) == 1), model.__name__)


def _type(annotation: Any) -> str:
    """Return the kind of value in plain words."""
    annotation = _bare(annotation)
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(_type(one) for one in arguments if one is not type(None)))
    if origin in (tuple, list):
        inner = dict.fromkeys(_type(one) for one in arguments if one is not Ellipsis)
        return (
            f"list of {' or '.join(inner)}"
            if Ellipsis in arguments
            else f"{len(arguments)} of {' or '.join(inner)}"
        )
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "keys below"
    names = {float: "number", int: "whole number", bool: "true or false", str: "text"}
    return names.get(annotation, "mapping" if origin is dict else "")
