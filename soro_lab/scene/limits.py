"""Limits of a scene where it states none: the range of the robot within that of what moves its air."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from soro_core.config import with_changes
from soro_core.errors import ConfigError
from soro_core.safety import HARD_LIMIT_PA, Limits, trips_above
from soro_lab.scene.scene import Scene

# What a scene states of the highest pressures itself.
_HIGHEST = {"maximum_pa", "over_pressure_pa", "burst_pressure_pa", "short_circuit_pa"}


def default_limits(scene: Scene, where: str) -> Limits:
    """Return the limits with a range for what the scene leaves open, no wider than any part allows.

    The range is that of the robot, where platform and valves, or the regulators of the twin allow it. On a
    platform the highest set point is at most that of the default: a higher one is stated with its trips.
    Without one the trips that the scene does not state are those of the range.

    Raises
    ------
    ConfigError
        If no set point is left.
    """
    limits, stated = scene.limits, scene.limits.model_fields_set
    robot = scene.loaded_robot
    own = robot.pressure_range_pa[0], robot.pressure_range_pa[1]
    allowed = _allowed(scene)
    parts = [own, *allowed.values()]
    low, high = max(part[0] for part in parts), min(part[1] for part in parts)
    if not low < high:
        got = f"{robot.name} of {_kpa(own)}"
        raise ConfigError(where, "robot", got, f"a pressure_range_pa that overlaps {_named(allowed)}")
    known = stated | limits.monitors.model_fields_set
    if high > limits.maximum_pa and scene.loaded_platform is None and not known & _HIGHEST:
        trips = trips_above(high)
        wider = {name: value for name, value in trips.pop("monitors", {}).items() if name not in known}
        limits = with_changes(
            limits, maximum_pa=high, monitors=with_changes(limits.monitors, **wider), **trips
        )
    wanted = {"minimum_pa": min(low, 0.0), "maximum_pa": min(high, limits.maximum_pa)}
    found = {name: value for name, value in wanted.items() if name not in stated}
    if found.get("maximum_pa", 1.0) <= 0.0:  # vacuum alone: 0 Pa is always allowed, to vent
        del found["maximum_pa"]
    return with_changes(limits, **found)


def unused_range(scene: Scene) -> list[str]:
    """Return a line each where the robot or the limits state a range of which other parts allow less.

    Also one where the default limit is all that holds back the others.
    """
    robot, limits, lines = scene.loaded_robot, scene.limits, []
    own = robot.pressure_range_pa[0], robot.pressure_range_pa[1]
    for name, stated in (
        (f"pressure_range_pa of {robot.name} is", own),
        ("limits are", (limits.minimum_pa, limits.maximum_pa)),
    ):
        less = {
            part: ends for part, ends in _allowed(scene).items() if stated[0] < ends[0] or stated[1] > ends[1]
        }
        if less:
            text = f"{_named(less)} {'allow' if len(less) > 1 else 'allows'} less"
            lines.append(f"{name} {_kpa(stated)}, but {text}")
    usual, most = Limits().maximum_pa, min(part[1] for part in (own, *_allowed(scene).values()))
    if limits.maximum_pa == usual < most:
        lines.append(
            f"limits.maximum_pa is {1e-3 * usual:g} kPa, but robot and valves allow {1e-3 * most:g} kPa: "
            "to use them state it, with its trips over_pressure_pa and burst_pressure_pa"
        )
    return lines


def _allowed(scene: Scene) -> dict[str, tuple[float, float]]:
    """Ranges of what moves the air, by name."""
    platform = scene.loaded_platform
    if platform is None:
        regulator = scene.regulator
        return {"twin.regulator": (max(regulator.minimum_pa, -HARD_LIMIT_PA), regulator.maximum_pa)}
    found = {f"range of {Path(scene.platform).stem}": (platform.range.minimum_pa, platform.range.maximum_pa)}
    if scene.emulates:
        regulator = platform.regulator
        name = f"regulator of {Path(scene.platform).stem}"
        found[name] = regulator.minimum_pa, regulator.maximum_pa
    return found


def _named(parts: Mapping[str, tuple[float, float]]) -> str:
    return " and ".join(f"{name} ({_kpa(part)})" for name, part in parts.items())


def _kpa(part: tuple[float, float]) -> str:
    return f"{1e-3 * part[0]:g} to {1e-3 * part[1]:g} kPa"
