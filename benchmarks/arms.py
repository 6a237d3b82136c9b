"""Arms without a controller file in closed loop: gains, scales and noise are automatic."""

from __future__ import annotations

import numpy as np

from benchmarks.options import Options
from benchmarks.report import table
from soro_core.errors import SoroError
from tests.soro_core.loop.arms import ARMS
from tests.soro_core.loop.loop_harness import run as run_loop

TITLE = "Arms with automatic gains"
SEEDS = (1, 2, 3, 4, 5)


def run(options: Options) -> str:
    """Measure and write."""
    seeds = options.pick(SEEDS, SEEDS[:1])
    rows = []
    for arm in options.pick(ARMS, ARMS[2:3]):
        found, said = [], ""
        for seed in seeds:
            options.say(f"{arm.name}, seed {seed}")
            robot, setup = arm.ready(seed, **({"duration_s": 4.0} if options.quick else {}))
            try:
                record = run_loop(robot, setup)
            except (SoroError, AssertionError):  # the plant of a lost arm has no step any more
                continue
            late = [s for s, t in zip(record.statuses, record.t, strict=True) if t > record.t[-1] - 5.0 and s]
            said = said or (late[0] if late else "")
            found.append(
                (
                    1e3 * record.rms(),
                    1e3 * record.peak(),
                    1e3 * record.estimation_rms(),
                    record.command_rate() / 1e3,
                )
            )
        if len(found) < len(seeds):
            rows.append([arm.name, f"{1e3 * arm.goal_m:.2f}", "lost", "-", "-", "-", said])
            continue
        rms, peak, filtered, rate = np.mean(found, axis=0)
        figures = [f"{rms:.3f}", f"{peak:.2f}", f"{filtered:.2f}", f"{rate:.0f}"]
        rows.append([arm.name, f"{1e3 * arm.goal_m:.2f}", *figures, said])
    head = [
        "arm",
        "goal, mm",
        "RMS, mm",
        "largest after 3 s, mm",
        "filter, mm",
        "rate, kPa/s",
        "what the status says in the last 5 s",
    ]
    return "\n\n".join(
        [
            "Law `composite`, plants of two to four links for one of the model behind lagging regulators, "
            "16 s, with no key of the law or the filter stated (`tests/soro_core/loop`, docs/gains.md): tip "
            "error RMS of the last 5 s, largest after 3 s, RMS of the filter's tip after 1 s, RMS rate of "
            f"the commands. Means of seeds {', '.join(map(str, seeds))}; lost: the plant has no next step.",
            table(head, rows),
        ]
    )
