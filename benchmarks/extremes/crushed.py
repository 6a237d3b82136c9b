"""Whether a link is crushed in truth: releases that must finish and stop, by error control.

Without losses and bent by turns the motion of many links is chaotic: runs that start a rounding apart have
nothing in common after a few swings. So no single run is the truth; but where runs that keep their energy
crush a link one after the other, so may any stepper that follows the motion.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.extremes.measure import Release
from benchmarks.options import Options
from benchmarks.report import figure, table
from soro_core import SoftArm, simulate
from soro_core.integrate.stepper import describe
from soro_core.model.dynamics import COLLAPSED

RTOL, START, RUNS = 1e-9, 1e-12, 8


def run(release: Release, seed: int) -> tuple[float | None, float]:
    """Time at which a link is crushed [s], if any, and how far the energy is off then, of the whole."""
    robot = release.arm.robot()
    arm = SoftArm(robot)
    bent = release.arm.coordinates(robot, 2.0 * np.pi * release.turns / release.arm.length)
    q0 = bent * (1.0 + START * np.random.default_rng(seed).standard_normal(bent.shape))
    result = simulate(
        arm, q0, t_end=release.steps * release.dt, dt=release.dt, integrator="dopri5", rtol=RTOL
    )
    first, last = (sum(arm.energy(result.q[k], result.qd[k])) for k in (0, -1))
    what = describe(COLLAPSED).message.partition(": ")[2]
    crushed = not result.status.ok and what in result.status.message
    return (float(result.t[-1]) if crushed else None), abs(last - first) / abs(first)


def text(stopped: Sequence[tuple[str, Release]], options: Options) -> str:
    """Markdown: of each release how many runs crush a link, when, and how well they keep the energy."""
    rows = []
    with multiprocessing.get_context("spawn").Pool() as pool:
        for name, release in stopped:
            options.say(f"in truth: {name}")
            ends = pool.map(partial(run, release), range(options.pick(RUNS, 2)))
            times = sorted(t for t, _ in ends if t is not None)
            shown = f"{figure(times[0])} to {figure(times[-1])}" if times else "-"
            worst = max(off for _, off in ends)
            rows.append([name, f"{len(times)} of {len(ends)}", shown, f"{worst:.0e}"])
    head = ["release that must finish and stopped", "runs that crush a link", "at, s", "energy off by"]
    how = f"By error control (dopri5, rtol {RTOL:g}) from starts that differ by {START:g}:"
    return f"{how}\n\n{table(head, rows)}"
