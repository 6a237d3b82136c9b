"""Differences of a real arm from the twin beside it, as figures and as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from soro_core.twin.shadow import DIFFERENCES
from soro_ros.recordings.recording import TopicSeries


@dataclass(frozen=True)
class Differences:
    """Differences of the measured tip from the shadow's tip, while under control."""

    samples: int
    distance_rms_m: float
    distance_max_m: float
    bending_mean_rad: float
    bending_rms_rad: float


def summarise(series: TopicSeries, duration_s: float) -> Differences | None:
    """Return the figures; None for a run without a shadow."""
    inside = (series.t >= 0.0) & (series.t <= duration_s)
    if not inside.any():
        return None
    distance = series.value[inside, DIFFERENCES.index("distance")]
    bending = series.value[inside, DIFFERENCES.index("bending")]
    return Differences(
        samples=int(inside.sum()),
        distance_rms_m=float(np.sqrt(np.mean(distance**2))),
        distance_max_m=float(distance.max()),
        bending_mean_rad=float(bending.mean()),
        bending_rms_rad=float(np.sqrt(np.mean(bending**2))),
    )


def rows(found: Differences | None) -> list[tuple[str, str]]:
    """The figures as lines of a table."""
    if found is None:
        return []
    far = f"{found.distance_rms_m * 1e3:.2f} / {found.distance_max_m * 1e3:.2f} mm"
    mean, rms = np.degrees([found.bending_mean_rad, found.bending_rms_rad])
    return [
        ("tip, measured to shadow, RMS / max", far),
        ("bending, measured less shadow, mean / RMS", f"{mean:+.2f} / {rms:.2f} deg"),
    ]


def draw(axes: Sequence[Any], series: TopicSeries, tolerance_m: float) -> None:
    """Draw distance and bending over time.

    Parameters
    ----------
    axes : sequence of matplotlib axes
        Two axes.
    series : TopicSeries
        Differences over time.
    tolerance_m : float
        Distance of a warning [m].
    """
    distance = series.value[:, DIFFERENCES.index("distance")] * 1e3
    axes[0].plot(series.t, distance, color="C4", lw=0.8, label="measured tip to shadow's")
    axes[0].axhline(tolerance_m * 1e3, color="0.3", ls="--", lw=0.8, label="warned of")
    axes[0].set(ylabel="distance [mm]", title="real arm and its shadow: tip", ylim=(0, None))
    for name, colour in (("bending", "C4"), ("rotation", "0.6")):
        angle = np.degrees(series.value[:, DIFFERENCES.index(name)])
        axes[1].plot(series.t, angle, color=colour, lw=0.8, label=f"{name}, measured less shadow")
    axes[1].set(ylabel="angle [deg]", title="real arm and its shadow: orientation")
