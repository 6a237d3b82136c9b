"""`composite` on arms that differ from their file in everything at once, drawn at random."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.options import Options
from benchmarks.report import table
from soro_core.config import parse
from soro_core.control import ControllerConfig
from soro_core.errors import SoroError
from soro_core.pneumatics import RegulatorModel
from soro_core.robot import Robot
from tests.soro_core.loop.loop_harness import Setup
from tests.soro_core.loop.loop_harness import run as run_loop

# Payload [kg], parts of stiffness, gain and damping, and lag of the regulators [s], each between two bounds.
LEAST, MOST = (0.0, 0.7, 0.9, 0.7, 0.03), (0.03, 1.3, 1.1, 1.3, 0.09)


def drawn(number: int) -> Setup:
    """Return the setup of one arm; the number is the seed of arm and noise."""
    payload, stiffness, gain, damping, tau = np.random.default_rng(number).uniform(LEAST, MOST).tolist()
    return Setup(
        payload_kg=payload,
        stiffness=stiffness,
        gain=gain,
        damping=damping,
        regulator=RegulatorModel(tau_s=tau),
        seed=number,
        control=parse({"law": "composite"}, ControllerConfig, "benchmark"),
    )


def run(robot: Robot, options: Options) -> str:
    """Measure the first of the arms and return text and table.

    Parameters
    ----------
    robot : Robot
        As the loop knows it.
    options : Options
        Number of arms.
    """
    errors = []
    for number in range(1, options.pick(options.arms, 1) + 1):
        options.say(f"random arm {number}")
        setup = drawn(number)
        try:
            record = run_loop(robot, replace(setup, duration_s=4.0) if options.quick else setup)
            errors.append(1e3 * record.rms())
        except (SoroError, AssertionError):  # the plant of a lost arm has no step any more
            errors.append(np.inf)
    found = np.array(errors)
    lost = int(np.sum(~(found < 1e2 * robot.length)))  # a tenth of the length, in mm
    middle, most, worst = np.quantile(found, [0.5, 0.95, 1.0], method="lower")
    text = (
        "Arms drawn evenly, the loop as before: 0 to 30 g; stiffness, gain, damping +-30, 10, 30 %; lag 30 "
        "to 90 ms. `composite`, tip error RMS of the last 5 of 20 s; lost: above a tenth of the length."
    )
    head = ["arms", "median, mm", "95 % below, mm", "worst, mm", "lost"]
    row = [f"{len(found)}", f"{middle:.3f}", f"{most:.3f}", f"{worst:.3f}", f"{lost}"]
    return f"{text}\n\n{table(head, [row])}"
