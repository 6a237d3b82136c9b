"""Robot files of arms whose place the scene states: nodes read a robot from a file, with its place."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from soro_core.config import with_changes
from soro_core.robot import load_robot, save_robot
from soro_lab.scene.scene import Scene


def with_robot_files(scene: Scene, folder: Path) -> Scene:
    """Return a scene whose nodes read each robot at its place: from a file in a folder."""
    return scene.of_each(partial(_with_robot_file, folder=folder))


def _with_robot_file(scene: Scene, folder: Path) -> Scene:
    if not scene.place:
        return scene
    file = folder / "robots" / f"{scene.prefix.rstrip('/') or scene.name}.yaml"
    file.parent.mkdir(exist_ok=True)
    save_robot(scene.loaded_robot, file)
    changed = scene.with_keys(robot=str(file), base_position=None, base_quaternion=None)
    if not scene.twin.plant:
        return changed
    plant = file.with_stem(f"{file.stem}_plant")
    save_robot(load_robot(scene.twin.plant).replace(**scene.place), plant)
    return changed.with_keys(twin=with_changes(scene.twin, plant=str(plant)))
