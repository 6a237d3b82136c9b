"""Strict YAML: a file becomes a frozen, checked object, or one line states its error."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from soro_core.errors import ConfigError, nearest
from soro_core.files.units import as_number, unit_of
from soro_core.files.yaml_text import LONGEST, read_value


class Strict(BaseModel):
    """Base of every configuration object: frozen, no unknown keys, no NaN, no silent conversions.

    Raises
    ------
    ConfigError
        If a value is not allowed, or changed afterwards.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    def __init__(self, /, *values: Any, **data: Any) -> None:
        name = type(self).__name__
        if values:
            raise ConfigError(name, "", values[0], f"values by name: {', '.join(type(self).model_fields)}")
        try:
            super().__init__(**data)
        except ValidationError as error:
            raise _first(error, type(self), where=name) from None

    # A section inside another one is checked by the outer one, which knows its place.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Check a section once: what is frozen does not change after its check."""

        def check(value: Any, inner: core_schema.ValidatorFunctionWrapHandler) -> Any:
            return value if type(value) is cls else inner(_as_numbers(value, cls))

        return core_schema.no_info_wrap_validator_function(check, handler(source))

    def __setattr__(self, name: str, value: Any) -> None:
        try:
            super().__setattr__(name, value)
        except ValidationError:
            allowed = "no change; make a new one with soro_core.config.with_changes, a robot with replace"
            raise ConfigError(type(self).__name__, name, value, allowed) from None


class InnerError(ValueError):
    """What a section breaks that another model checks; the key of the section is put before its own.

    Parameters
    ----------
    error : pydantic.ValidationError
        What is wrong.
    model : type of pydantic.BaseModel
        Model that found it.
    """

    def __init__(self, error: ValidationError, model: type[BaseModel]) -> None:
        self.error, self.model = error, model
        super().__init__(str(error))


def _as_numbers(data: Any, model: type[Strict]) -> Any:
    """Return the keys and values of a section with texts like 40kPa as numbers in the units of the keys."""
    if not isinstance(data, Mapping):
        return data
    read = dict(data)
    for key, unit in _units(model).items():
        if isinstance(value := read.get(key), str | list | tuple | Mapping):
            try:
                read[key] = as_number(value, unit)
            except ValueError as error:
                custom = PydanticCustomError("value_error", "{text}", {"text": str(error)})
                details: Any = {"type": custom, "loc": (key,), "input": value}
                raise InnerError(
                    ValidationError.from_exception_data(model.__name__, [details]), model
                ) from None
    return read


@cache
def _units(model: type[Strict]) -> dict[str, str]:
    """Units of the fields of a model that hold numbers with a unit."""
    numbers = (name for name, field in model.model_fields.items() if _has_numbers(field.annotation))
    return {name: unit for name in numbers if (unit := unit_of(name, model.__name__))}


def _has_numbers(annotation: Any) -> bool:
    return annotation is float or any(map(_has_numbers, get_args(annotation)))


# A YAML list for a frozen tuple; the elements stay strict.
# No number of a list is larger: products of several would not be finite.
_Number = Annotated[float, Field(ge=-1e12, le=1e12)]
Floats = Annotated[tuple[_Number, ...], Field(strict=False)]


def _flat(value: Any) -> Any:
    if isinstance(value, list | tuple) and value and all(isinstance(row, list | tuple) for row in value):
        for k, row in enumerate(value):
            if len(row) != 3:
                raise ValueError(f"rows of 3 numbers, not {len(row)} in row {k}")
        return [number for row in value for number in row]
    return value


# Coordinates of points, which a file may divide into rows of three; a node's parameter cannot.
Points = Annotated[Floats, BeforeValidator(_flat)]
Strings = Annotated[tuple[str, ...], Field(strict=False)]

Model = TypeVar("Model", bound=Strict)


def load(path: str | Path, model: type[Model]) -> Model:
    """Read a YAML file into `model`.

    Raises
    ------
    ConfigError
        If the file is missing, is no YAML mapping, repeats a key, or holds a value that is not allowed.
    """
    return parse(read_yaml(path), model, where=str(path))


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Read a YAML file that must be a mapping without repeated keys."""
    try:
        if (size := Path(path).stat().st_size) > LONGEST:
            allowed = f"{LONGEST} bytes or fewer; arrays in files of their own"
            raise ConfigError(str(path), "", f"{size} bytes", allowed)
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError(
            str(path), "", "no such file", f"an existing YAML file{_shipped(Path(path))}"
        ) from None
    except (OSError, ValueError) as error:  # ValueError: no UTF-8, or no path
        raise ConfigError(str(path), "", str(error), "a readable UTF-8 file") from None
    return read_mapping(text, where=str(path))


def read_mapping(text: str, where: str) -> dict[str, Any]:
    """Read YAML text that must be a mapping without repeated keys; `where` is named in the error."""
    data = read_value(text, where)
    if not isinstance(data, dict):
        raise ConfigError(where, "", data, "a mapping of keys to values")
    return data


def parse(data: Mapping[str, Any], model: type[Model], where: str) -> Model:
    """Return the checked model of a mapping.

    Parameters
    ----------
    data : mapping of str to object
        Keys and values.
    model : type of pydantic.BaseModel
        Model that checks them.
    where : str
        File that errors name.

    Raises
    ------
    ConfigError
        If a key or a value is not allowed.
    """
    if not isinstance(data, Mapping):
        raise ConfigError(where, "", data, "a mapping of keys to values")
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        raise _first(error, model, where) from None


def with_renamed(data: Any, renamed: Mapping[str, str]) -> Any:
    """Return the keys and values of a file with former keys under their names of today.

    Parameters
    ----------
    data : object
        Keys and values; anything but a mapping is returned as it is.
    renamed : mapping of str to str
        Today's key by the former one, which may be in a section: ``section.key``. Each former key that a file
        has is logged, once a process.

    Raises
    ------
    ValueError
        If a file has a key under both names.
    """
    if not isinstance(data, Mapping):
        return data
    result = dict(data)
    for former, today in renamed.items():
        section, _, key = former.rpartition(".")
        holder = result.get(section) if section else result
        if not isinstance(holder, Mapping) or key not in holder:
            continue
        if today in result:
            raise ValueError(f"{today} without {former}, which is its former name")
        rest = {name: value for name, value in holder.items() if name != key}
        result = {**result, section: rest} if section else rest
        result[today] = holder[key]
        _log_renamed(former, today)
    return result


@cache
def _log_renamed(former: str, today: str) -> None:
    logging.getLogger("soro_core").warning(
        "%s is read as %s, its name of today: rename the key", former, today
    )


def with_changes(model: Model, /, **values: Any) -> Model:
    """Return a configuration object with other values, checked like the first one.

    Pydantic's `model_copy(update=...)` does not check the new values.

    Parameters
    ----------
    model : Strict
        The object to start from; what it leaves to the defaults stays at the defaults.
    **values
        The new values by key.

    Raises
    ------
    ConfigError
        If a key is unknown, or a value or a combination of values is not allowed.
    """
    kept = {name: getattr(model, name) for name in model.model_fields_set}
    return type(model)(**{**kept, **values})


def find_config(name: str | Path, kind: str) -> Path:
    """Resolve a name (``tue_three_bellow``) or a path to a file in ``config/<kind>/``.

    Parameters
    ----------
    name : str or Path
        A path that exists, or the name of a shipped file without its ending.
    kind : str
        robots, platforms, scenes, controllers or recordings.
    """
    if not isinstance(name, str | Path):
        raise ConfigError(kind, "", name, "a path ending in .yaml, or the name of a shipped file")
    path = Path(name)
    if path.suffix:
        return path
    folder = config_folder() / kind
    shipped = folder / f"{path.name}.yaml"
    if shipped.is_file():
        return shipped
    names = sorted(p.stem for p in folder.glob("*.yaml"))
    known, near = ", ".join(names) or "none", nearest(path.name, names)
    raise ConfigError(
        str(name), "", f"no {kind} file of that name", f"a path ending in .yaml, or one of {known}{near}"
    )


def completer_of(*kinds: str) -> Callable[[str], list[str]]:
    """Return the function that completes names of shipped files in a shell.

    Parameters
    ----------
    *kinds : str
        Folders in ``config/``: robots, platforms, scenes.
    """

    def complete(incomplete: str) -> list[str]:
        found = (file.stem for kind in kinds for file in (config_folder() / kind).glob("*.yaml"))
        return sorted(name for name in found if name.startswith(incomplete))

    return complete


def name_argument(text: str, *kinds: str) -> Any:
    """Return an argument of a command that is a file or the name of a shipped one of some kinds."""
    import typer

    return typer.Argument(help=text, autocompletion=completer_of(*kinds))


def _shipped(path: Path) -> str:
    """Say by which name a file of this folder and name comes with soro; "" where none does."""
    is_shipped = (config_folder() / path.parent.name / path.name).is_file()
    return f", or {path.stem} for the one that comes with soro" if is_shipped else ""


def config_folder() -> Path:
    """Folder of the shipped configuration: beside the package in a checkout, else in share/soro_ros."""
    beside = Path(__file__).resolve().parent.parent
    prefixes = (*beside.parents, Path(sys.prefix))
    for root in (beside, *(prefix / "share" / "soro_ros" for prefix in prefixes)):
        if (root / "config" / "platforms").is_dir():
            return root / "config"
    raise ConfigError(
        "config", "", "no shipped configuration found", "an installation with share/soro_ros/config"
    )


# Plain names in place of pydantic's names of types.
_PLAIN = {
    "tuple_type": "a list",
    "dict_type": "a mapping of keys to values",
    "model_type": "a mapping of keys to values",
    "bool_type": "true or false",
}


def _first(error: ValidationError, model: type[BaseModel], where: str) -> ConfigError:
    found = error.errors()
    details = found[0]
    beside = [e for e in found if e["loc"][:-1] == details["loc"][:-1]]
    if details["type"] == "missing":  # a wrong name of the same key is the better message
        details = next((e for e in beside if e["type"] == "extra_forbidden"), details)
    location = _without_tags(model, details["loc"])
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).lstrip(".")
    if details["type"] == "union_tag_invalid":
        context = details["ctx"]
        tag = context["discriminator"].strip("'")
        return ConfigError(where, f"{key}.{tag}", context["tag"], f"one of {context['expected_tags']}")
    if details["type"] == "extra_forbidden":
        keys = list(getattr(_walk(model, details["loc"][:-1])[0], "model_fields", {}))
        known = ", ".join(keys) or "no such key"
        lacking = [_meaning(model, e["loc"]) for e in beside if e["type"] == "missing"]
        needed = "".join(f"; required is {one}" for one in lacking)
        return ConfigError(where, key, "an unknown key", known + nearest(str(location[-1]), keys) + needed)
    if details["type"] == "missing":
        return ConfigError(where, key, "nothing", f"a value; required is {_meaning(model, details['loc'])}")
    inner = details.get("ctx", {}).get("error")
    if isinstance(inner, InnerError):
        cause = _first(inner.error, inner.model, where)
        return ConfigError(where, f"{key}.{cause.key}".strip("."), cause.got, cause.allowed)
    allowed = _PLAIN.get(details["type"]) or details["msg"].removeprefix("Value error, ")
    is_rule = details["type"] == "value_error"
    return ConfigError(where, key, details["input"], allowed[:1].lower() + allowed[1:], is_rule)


def _meaning(model: type[BaseModel], location: tuple[int | str, ...]) -> str:
    """Return a key with its description."""
    field = getattr(_walk(model, location[:-1])[0], "model_fields", {}).get(location[-1])
    return ", ".join(filter(None, (str(location[-1]), getattr(field, "description", None))))


def section_of(model: type[BaseModel], key: str) -> type[Strict] | None:
    """Return the class of a section of a model, if the key is one and it has a single class."""
    field = model.model_fields.get(key)
    found = _nested_models(field.annotation) if field else []
    return found[0] if len(found) == 1 else None


def _without_tags(model: type[BaseModel], location: tuple[int | str, ...]) -> list[int | str]:
    """A location as the file has it: pydantic puts the tag of a discriminated union into it."""
    return _walk(model, location)[1]


def _walk(model: type[BaseModel], location: tuple[int | str, ...]) -> tuple[Any, list[int | str]]:
    """Model at a location, and the location without tags."""
    current: Any = model
    path: list[int | str] = []
    candidates: list[Any] = [model]
    for part in location:
        tagged = [m for m in candidates if len(candidates) > 1 and _has_tag(m, part)]
        if tagged:
            current, candidates = tagged[0], tagged
            continue
        path.append(part)
        field = None if isinstance(part, int) else getattr(current, "model_fields", {}).get(part)
        if field is not None:
            candidates = _nested_models(field.annotation)
            current = candidates[0] if candidates else None
    return current, path


def _has_tag(model: type[BaseModel], tag: int | str) -> bool:
    return any(tag in get_args(field.annotation) for field in model.model_fields.values())


def _nested_models(annotation: Any) -> list[Any]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for argument in get_args(annotation) for found in _nested_models(argument)]
