"""Arms that no file states: described, excited, identified and controlled, unattended."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from benchmarks.options import Options
from benchmarks.report import table
from benchmarks.timing import all_cores
from tests.soro_ros.whole_way import ARMS, MISMATCHED, NewArm, walk

TITLE = "From a description to a controlled arm"


def run(options: Options) -> str:
    """Measure and write."""
    with all_cores():
        rows = [_row(arm, options) for arm in options.pick((*ARMS, *MISMATCHED), ())]
    head = [
        "arm",
        "numbers that the data determine",
        "of them right",
        "beyond three deviations",
        "open",
        "tip, % of the length",
        "min",
    ]
    return "\n\n".join(
        [
            "`soro new`, `soro excite`, `soro identify`, `soro run` with `gains: auto`, all in lockstep; the "
            "arm is a twin with other stiffness, damping, gains and chambers than its description, behind "
            "emulated regulators with play and lag and a tracker in an unknown frame "
            "(`tests/soro_ros/whole_way.py`). Right: within 3 % or two deviations. Repeat: `make identify`. "
            f"The last {len(MISMATCHED)} arms have a structure that their description lacks: strains that "
            "vary (Legendre, order 1), creep of 10 % in 0.5 s, a chamber at 55 %, and all three.",
            table(head, rows),
        ]
    )


def _row(arm: NewArm, options: Options) -> list[str]:
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        try:
            outcome = walk(arm, Path(folder), options.say, environment)
        except AssertionError as error:
            return [arm.name, f"failed: {str(error).splitlines()[0]}", *["-"] * 5]
    wrong = ", ".join(n.name for n in outcome.numbers if not n.is_right)
    right = f"{sum(n.is_right for n in outcome.numbers)}" + (f"; not {wrong}" if wrong else "")
    return [
        arm.name,
        str(len(outcome.numbers)),
        right,
        str(sum(not n.is_in_bar for n in outcome.numbers)),
        ", ".join(outcome.open) or "none",
        f"{100 * outcome.tip_m / outcome.length_m:.2f}",
        f"{(time.perf_counter() - start) / 60:.1f}",
    ]
