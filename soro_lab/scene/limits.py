"""Limits of a scene where it states none: the range of the robot within that of what moves its air."""

from __future__ import annotations

from pathlib import Path

from soro_core.config import changed
from soro_core.errors import ConfigError
from soro_core.safety import Limits, Rating
from soro_lab.scene.scene import Scene


def default_limits(scene: Scene, where: str) -> Limits:
    """Return the limits with a range for what the scene leaves open, no wider than any part allows.

    The lowest set point is that of the robot's range, where platform, its rating and its valves, or the
    regulators of the twin allow it. The highest is the lowest of theirs and of the default.

    Parameters
    ----------
    scene : Scene
        With robot and platform.
    where : str
        File of the scene, for errors.

    Raises
    ------
    ConfigError
        If no set point is left.
    """
    limits, stated = scene.limits, scene.limits.model_fields_set
    robot = scene.loaded_robot
    own = robot.pressure_range_pa[0], robot.pressure_range_pa[1]
    parts = [own, *_allowed(scene).values()]
    low, high = max(part[0] for part in parts), min(part[1] for part in parts)
    if not low < high:
        got = f"{robot.name} of {_kpa(own)}"
        raise ConfigError(where, "robot", got, f"a range that overlaps that of {_named(scene)}")
    wanted = {"minimum_pa": min(low, 0.0), "maximum_pa": min(high, limits.maximum_pa)}
    found = {name: value for name, value in wanted.items() if name not in stated}
    if found.get("maximum_pa", 1.0) <= 0.0:  # vacuum alone: 0 Pa is always allowed, to vent
        del found["maximum_pa"]
    return changed(limits, **found)


def unused_range(scene: Scene) -> list[str]:
    """Return a line for a range that the robot or the limits state and that another part does not allow."""
    lines = []
    low, high = scene.loaded_robot.pressure_range_pa
    for name, (least, most) in _allowed(scene).items():
        if low < least or high > most:
            text = f"{name} allows {_kpa((least, most))}: the rest is not used"
            lines.append(f"pressure_range_pa of {scene.loaded_robot.name} is {_kpa((low, high))}, but {text}")
        wanted = scene.limits.minimum_pa, scene.limits.maximum_pa
        if wanted[0] < least or wanted[1] > most:
            lines.append(f"limits of {_kpa(wanted)}, but {name} allows {_kpa((least, most))}")
    return lines


def _allowed(scene: Scene) -> dict[str, tuple[float, float]]:
    """Ranges of what moves the air, by name."""
    platform = scene.loaded_platform
    if platform is None:
        regulator, rating = scene.regulator, Rating()
        return {"twin.regulator": (max(regulator.minimum_pa, rating.minimum_pa), regulator.maximum_pa)}
    found = {f"range of {Path(scene.platform).stem}": (platform.range.minimum_pa, platform.range.maximum_pa)}
    if scene.emulates:
        regulator = platform.emulation.regulator
        name = f"emulation.regulator of {Path(scene.platform).stem}"
        found[name] = regulator.minimum_pa, regulator.maximum_pa
    return found


def _named(scene: Scene) -> str:
    return ", ".join(f"{name} ({_kpa(part)})" for name, part in _allowed(scene).items())


def _kpa(part: tuple[float, float]) -> str:
    return f"{1e-3 * part[0]:g} to {1e-3 * part[1]:g} kPa"
