"""How well the arm of a scene follows its reference in one process."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from soro_lab.scene import Scene
from soro_ros.study.closed_loop import RunTick, ticks_of


def tip_errors_m(ticks: Iterable[RunTick]) -> np.ndarray:
    """Return the distance of the tip from its reference [m] at each tick under control."""
    ticks = list(ticks)
    return np.array([np.linalg.norm((t.seen.tip - t.command.tip_reference)[:3, 3]) for t in ticks])


def tip_error_rms_m(scene: Scene, first_s: float, last_s: float) -> float:
    """Return the distance of the tip from its reference between two times, RMS [m]."""
    errors = tip_errors_m(ticks_of(scene.with_keys(duration_s=last_s)))[round(scene.rate_hz * first_s) :]
    return float(np.sqrt(np.mean(errors**2)))
