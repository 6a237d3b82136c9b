"""The section `bodies` of a file: what arms touch, by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, TypeAlias

from pydantic import Field

from soro_core.bodies.body import RigidBody
from soro_core.config import Strict, parse, read_yaml

# Their names are those of topics.
Bodies: TypeAlias = Mapping[Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")], RigidBody]


class _Section(Strict):
    bodies: Bodies = Field(description="by name")


def find_shapes(bodies: object, folder: Path) -> None:
    """Put the whole paths of files of shapes that are in a folder into a section `bodies`, as it was read."""
    for body in bodies.values() if isinstance(bodies, dict) else ():
        shape = body.get("shape") if isinstance(body, dict) else None
        if isinstance(shape, dict) and (folder / (name := str(shape.get("file", "")))).is_file():
            shape["file"] = str((folder / name).absolute())


def load_bodies(file: str | Path) -> dict[str, RigidBody]:
    """Read the section `bodies` of a file, such as a scene; files of shapes are found beside it.

    Raises
    ------
    ConfigError
        If it has none, or a key or a value is not allowed.
    """
    data = {key: value for key, value in read_yaml(file).items() if key == "bodies"}
    find_shapes(data.get("bodies"), Path(file).parent)
    return dict(parse(data, _Section, where=str(file)).bodies)
