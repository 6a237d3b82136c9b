"""Plots of the pressures and of the error of the tip, in the panel of the view."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import viser
from viser.uplot import Scale, Series

from soro_ros.view.arm_shape import COLOURS
from soro_ros.view.moment import Moment

# A plot is sent as a whole, and its lines are too thin to be read at the rate of the arm.
_PERIOD_S = 0.25


class Plots:
    """Two plots over time.

    Parameters
    ----------
    gui : viser.GuiApi
    chambers : sequence of str
        Names of the chambers.
    most_pa : float
        Highest pressure [Pa gauge].
    """

    def __init__(self, gui: viser.GuiApi, chambers: Sequence[str], most_pa: float) -> None:
        self._chambers, self._shown_s = chambers, 0.0
        colours = [COLOURS[k % len(COLOURS)] for k in range(len(chambers))]
        lines = [Series(label=name, stroke=c, width=2) for name, c in zip(chambers, colours, strict=True)]
        self._pressure = _plot(gui, "pressure [kPa]", lines, Scale(auto=True, range=(0.0, most_pa / 1e3)))
        error = [Series(label="distance", stroke="#c1121f", width=2)]
        self._error = _plot(gui, "tip to reference [mm]", error, Scale(auto=True))

    def show(self, past: Sequence[Moment], at_once: bool = False) -> None:
        """Draw moments; only now and then, unless `at_once`."""
        now_s = time.monotonic()
        if now_s < self._shown_s + _PERIOD_S and not at_once:
            return
        self._shown_s = now_s
        t = np.array([one.t_s for one in past])
        pressures = [[one.pressure.get(name, np.nan) for one in past] for name in self._chambers]
        self._pressure.data = (t, *(np.array(values) * 1e-3 for values in pressures))
        self._error.data = (t, np.array([one.error_m for one in past]) * 1e3)


def _plot(gui: viser.GuiApi, title: str, lines: Sequence[Series], y: Scale) -> viser.GuiUplotHandle:
    return gui.add_uplot(
        data=tuple(np.zeros(1) for _ in range(len(lines) + 1)),
        series=(Series(label="t [s]"), *lines),
        scales={"x": Scale(time=False), "y": y},
        title=title,
        aspect=1.7,
    )
