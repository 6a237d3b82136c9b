"""Options of the commands that run a scene, and the keys that they change."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, TypeAlias

import typer

from soro_core.config import Strict, name_argument, section_of
from soro_core.errors import ConfigError
from soro_core.files.yaml_text import read_value

SCENE_HELP = "Scene file, or the name of a shipped one."
SceneName: TypeAlias = Annotated[str, name_argument(SCENE_HELP, "scenes")]


def complete_key(incomplete: str) -> list[str]:
    """Complete the key of a --set: those of a section after a point, else the sections."""
    from soro_lab.scene.scene import Scene

    *sections, _ = incomplete.split(".")
    model: type[Strict] | None = Scene
    for section in sections:
        model = section_of(model, section) if model else None
    before = ".".join((*sections, ""))
    found = [
        before + key
        for key in (model.model_fields if model else ())
        if f"{before}{key}".startswith(incomplete)
    ]
    if model and len(found) == 1 and section_of(model, found[0].removeprefix(before)):
        return complete_key(f"{found[0]}.")  # a shell sets a space after a single one
    return [key if model and section_of(model, key.removeprefix(before)) else f"{key}=" for key in found]


Change: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key of the scene: controller.adapt=false, twin.payload_kg=10g.",
        autocompletion=complete_key,
    ),
]
Valves: TypeAlias = Annotated[
    str | None, typer.Option(help="emulated, or real: those of the platform, there already.")
]
Device: TypeAlias = Annotated[
    str | None, typer.Option(help="Path or address of real valves; implies --valves real.")
]
Arm: TypeAlias = Annotated[
    str | None,
    typer.Option(help="simulated, or real: its sensors publish, the twin runs beside it as a shadow."),
]
Folder: TypeAlias = Annotated[Path, typer.Option(help="Where the folder of the run is made.")]


def changes_of(
    command: str, given: list[str], valves: str | None, device: str | None, arm: str | None
) -> dict[str, Any]:
    """Return the keys of a scene that options change, with their values.

    Parameters
    ----------
    command : str
        Name of the command, for errors.
    given : list of str
        KEY=VALUE of each --set.
    valves, device, arm : str or None
        Values of these options.
    """
    changes = given_keys(given)
    if device == "":  # of a shell variable that is not set: the run would be on emulated valves
        raise ConfigError(command, "--device", device, "the path or address of the valves")
    options = {"valves": valves or ("real" if device else None), "device": device, "arm": arm}
    return changes | {key: value for key, value in options.items() if value is not None}


def given_keys(given: list[str]) -> dict[str, Any]:
    """Return the keys of a scene that KEY=VALUE change, with their values."""
    changes: dict[str, Any] = {}
    for item in given:
        key, equals, value = item.partition("=")
        if not key or not equals:
            raise ConfigError("--set", "", item, "KEY=VALUE, for example controller.adapt=false")
        changes[key] = read_value(value, f"--set {key}") if value else ""
    return changes
