"""Write the files of a new arm: all of them, checked as they are read, or none."""

from __future__ import annotations

import secrets
import shutil
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from soro_core.errors import ConfigError
from soro_core.robot import load_robot
from soro_lab.scaffold.arm import ArmSetting, NewArm
from soro_lab.scaffold.options import WHERE
from soro_lab.scaffold.platform_file import platform_header, platform_name, platform_tree
from soro_lab.scaffold.quantity import Noted
from soro_lab.scaffold.reference import FirstReference, first_reference, rests
from soro_lab.scaffold.robot_file import robot_header, robot_tree
from soro_lab.scaffold.scene_file import scene_header, scene_tree
from soro_lab.scene import check_scene, load_scene
from soro_lab.scene.loop import loop_of

WIDTH = 118


def commented(header: str, tree: Mapping[str, Any]) -> str:
    """Return a file.

    Parameters
    ----------
    header : str
        Comment at the top, with its line breaks.
    tree : mapping
        Of names to `Noted` values, mappings, or lists of mappings.
    """
    top = [line for text in header.splitlines() for line in textwrap.wrap(text, WIDTH - 2) or [""]]
    lines = [f"# {line}".rstrip() for line in top] + _mapping(tree, "")
    return "\n".join(lines) + "\n"


def _mapping(tree: Mapping[str, Any], indent: str) -> list[str]:
    lines: list[str] = []
    for key, node in tree.items():
        if isinstance(node, Noted):
            lines += _value(f"{indent}{key}: {scalar(node.value)}", node.note, indent)
        elif isinstance(node, Mapping):
            lines += [f"{indent}{key}:", *_mapping(node, f"{indent}  ")]
        else:
            lines.append(f"{indent}{key}:")
            lines += [line for item in node for line in _item(item, f"{indent}  ")]
    return lines


def _item(item: Any, indent: str) -> list[str]:
    """Return one entry of a list."""
    if isinstance(item, Noted):
        return _value(f"{indent}- {scalar(item.value)}", item.note, indent)
    lines = _mapping(item, f"{indent}  ")
    first = next(k for k, line in enumerate(lines) if not line.lstrip().startswith("#"))
    dash = len(indent)
    lines[first] = f"{lines[first][:dash]}-{lines[first][dash + 1 :]}"
    return lines


def _value(line: str, note: str, indent: str) -> list[str]:
    """Return a line with its comment behind it, or above it where that is too long."""
    if not note:
        return [line]
    behind = f"{line}  # {note}"
    if len(behind) <= WIDTH:
        return [behind]
    return [*(f"{indent}# {part}" for part in textwrap.wrap(note, WIDTH - len(indent) - 2)), line]


def scalar(value: Any) -> str:
    """Return a value as YAML in one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {scalar(each)}" for key, each in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(scalar, value)) + "]"
    return "null" if value is None else str(value)


def _number(value: float) -> str:
    """Return a float that YAML 1.1 and 1.2 both read as one."""
    text = f"{value:.12g}"
    mantissa, e, exponent = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return mantissa + e + exponent


@dataclass(frozen=True)
class Written:
    """What has been written.

    Attributes
    ----------
    robot, platform, scene : Path
        The files.
    reference : FirstReference
        Of the scene.
    warnings : tuple of str
        What the numbers of the arm make unlikely to work, a line each.
    """

    robot: Path
    platform: Path
    scene: Path
    reference: FirstReference
    warnings: tuple[str, ...]


def write_arm(
    arm: NewArm, folder: Path, force: bool = False, say: Callable[[str], None] = lambda text: None
) -> Written:
    """Write robot, platform and scene into a folder.

    Parameters
    ----------
    arm : NewArm
    folder : Path
        Made where it does not exist.
    force : bool
        Whether existing files are replaced.
    say : callable
        Called with a line before what takes long where the model is not compiled.

    Raises
    ------
    ConfigError
        If a file exists, the folder cannot be written to, or the arm does not fit the platform.
    """
    names = tuple(f"{arm.name}_{kind}.yaml" for kind in ("robot", "platform", "scene"))
    there = [folder / name for name in names if (folder / name).exists()]
    if there and not force:
        allowed = "a folder without these files, or --force to replace them"
        raise ConfigError(WHERE, "--out", ", ".join(map(str, there)), allowed)
    platform_name(arm.setting.platform, sum(arm.setting.chambers))  # refuses what there is not
    say(f"{arm.name}: looking for a motion that its pressures hold, by the model; then come its files")
    try:
        ancestor = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        made = ancestor / f".soro_new_{secrets.token_hex(4)}"
        try:  # around the making too: a signal leaves nothing
            made.mkdir()
            reference, warnings = _write(arm, made, names)
            folder.mkdir(parents=True, exist_ok=True)
            for name in names:
                (made / name).replace(folder / name)
        finally:
            shutil.rmtree(made, ignore_errors=True)
    except OSError as error:
        allowed = f"a folder that can be written to ({error.strerror})"
        raise ConfigError(WHERE, "--out", str(folder), allowed) from None
    robot, platform, scene = (folder / name for name in names)
    return Written(robot, platform, scene, reference, warnings)


def _write(arm: NewArm, folder: Path, names: tuple[str, ...]) -> tuple[FirstReference, tuple[str, ...]]:
    """Write the files into an empty folder, each read back; return the reference, and warnings."""
    (folder / names[0]).write_text(commented(robot_header(arm), robot_tree(arm)))
    return write_setting(arm.setting, folder, names)


def write_setting(
    arm: ArmSetting, folder: Path, names: tuple[str, ...]
) -> tuple[FirstReference, tuple[str, ...]]:
    """Write platform and scene beside a robot file, each read back.

    Parameters
    ----------
    arm : ArmSetting
    folder : Path
    names : tuple of str
        Files of robot, platform and scene; the robot file exists.

    Returns
    -------
    FirstReference
        Of the scene.
    tuple of str
        What the numbers of the arm make unlikely to work, a line each.

    Raises
    ------
    ConfigError
        If the arm does not fit the platform.
    """
    robot_name, platform, scene = names
    shipped = platform_name(arm.platform, sum(arm.chambers))
    (folder / platform).write_text(commented(platform_header(arm, shipped), platform_tree(arm, shipped)))
    robot = load_robot(folder / robot_name)
    reference = first_reference(robot)
    tree = scene_tree(arm, robot, reference, (robot_name, platform))
    (folder / scene).write_text(commented(scene_header(arm, reference, scene), tree))
    loaded = load_scene(folder / scene)
    warnings = check_scene(loaded, scene)
    loop_of(loaded)
    if not rests(robot, loaded.twin_node().refine):
        warnings.append(
            f"{arm.name} has no stable rest without pressure under its weight: it is too soft, too heavy or "
            "too long; or --mounting hanging"
        )
    return reference, tuple(warnings)
