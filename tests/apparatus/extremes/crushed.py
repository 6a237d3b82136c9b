"""Whether a link is crushed in truth: releases that must finish and stop, by error control.

Without losses and bent by turns the motion of many links is chaotic: runs that start a rounding apart have
nothing in common after a few swings. So no single run is the truth; but where runs that keep their energy
crush a link one after the other, so may any stepper that follows the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.options import Options
from benchmarks.report import figure, table
from soro_core import simulate
from soro_core.integrate.causes import CAUSES
from soro_core.jobs import Processes, map_jobs
from soro_core.model.dynamics import COLLAPSED
from tests.apparatus.extremes.measure import Release, energy, scale_of

RTOL, START, RUNS = 1e-9, 1e-12, 8


def run(release: Release, seed: int) -> tuple[float | None, float]:
    """Time at which a link is crushed [s], if any, and error of the energy, of what the arm can give."""
    arm, q0, p = release.start()
    q0 *= 1.0 + START * np.random.default_rng(seed).standard_normal(q0.shape)
    t_end = release.steps * release.dt
    result = simulate(arm, q0, t_end=t_end, dt=release.dt, integrator="dopri5", rtol=RTOL, pressure=p)
    off = abs(energy(arm, result, -1, p) - energy(arm, result, 0, p)) / scale_of(arm, result)
    what = CAUSES[COLLAPSED]
    crushed = not result.status.ok and what in result.status.message
    return (float(result.t[-1]) if crushed else None), off


def text(stopped: Sequence[tuple[str, Release]], options: Options) -> str:
    """Markdown: of each release how many runs crush a link, when, and how well they keep the energy."""
    rows = []
    with Processes() as executor:
        for name, release in stopped:
            options.say(f"in truth: {name}")
            ends = list(map_jobs(partial(run, release), range(options.pick(RUNS, 2)), executor))
            times = sorted(t for t, _ in ends if t is not None)
            shown = f"{figure(times[0])} to {figure(times[-1])}" if times else "-"
            worst = max(off for _, off in ends)
            rows.append([name, f"{len(times)} of {len(ends)}", shown, f"{worst:.0e}"])
    head = ["release that must finish and stopped", "runs that crush a link", "at, s", "energy off by"]
    how = f"By error control (dopri5, rtol {RTOL:g}) from starts that differ by {START:g}:"
    return f"{how}\n\n{table(head, rows)}"
