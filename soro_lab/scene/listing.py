"""The scenes of a folder: what each of them shows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from soro_core.config import config_folder, read_yaml
from soro_core.errors import ConfigError
from soro_lab.scene.load import load_scene
from soro_lab.scene.scene import Scene


@dataclass(frozen=True)
class Listing:
    """The YAML files of a folder.

    Attributes
    ----------
    scenes : tuple of Scene
        In the order of their files.
    wrong : tuple of str
        A line for each scene that cannot be read.
    others : tuple of str
        The files that are no scenes, and why.
    """

    scenes: tuple[Scene, ...]
    wrong: tuple[str, ...]
    others: tuple[str, ...]


def shipped_folder() -> Path:
    """Folder of the shipped scenes."""
    return config_folder() / "scenes"


def scenes_in(folder: Path) -> Listing:
    """Return the scenes of a folder: the YAML files all of whose keys are those of a scene.

    Parameters
    ----------
    folder : Path
    """
    scenes, wrong, others = [], [], []
    for file in sorted(folder.glob("*.yaml")):
        try:
            foreign = [key for key in read_yaml(file) if key not in Scene.model_fields]
            if foreign:
                others.append(f"{file.name} (key {foreign[0]})")
                continue
            scenes.append(load_scene(file))
        except ConfigError as error:
            wrong.append(str(error))
    return Listing(tuple(scenes), tuple(wrong), tuple(others))
