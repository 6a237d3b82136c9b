"""The section `bodies` of a file: what arms touch, by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from pydantic import Field, TypeAdapter, ValidationError

from soro_core.bodies.body import RigidBody
from soro_core.config import InnerError, Strict, parse, read_yaml

# What a name of ROS may be called.
_Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
_Bodies: TypeAlias = dict[_Name, RigidBody]


class _Section(Strict):
    bodies: Mapping[_Name, RigidBody] = Field(description="by name")


def bodies_of(section: Mapping[str, Any]) -> dict[str, RigidBody]:
    """Return the bodies of a section.

    Raises
    ------
    InnerError
        If a key or a value is not allowed; for the model that has the section.
    """
    try:
        return TypeAdapter(_Bodies).validate_python(dict(section))
    except ValidationError as error:
        raise InnerError(error, RigidBody) from None


def load_bodies(file: str | Path) -> dict[str, RigidBody]:
    """Read the section `bodies` of a file, such as a scene.

    Raises
    ------
    ConfigError
        If it has none, or a key or a value is not allowed.
    """
    data = {key: value for key, value in read_yaml(file).items() if key == "bodies"}
    return dict(parse(data, _Section, where=str(file)).bodies)
