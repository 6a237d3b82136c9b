"""The external force at the tip: its error and deviation under steps of a lateral force, and its stages."""

from __future__ import annotations

import time
from itertools import product

import numpy as np

from benchmarks import false_contacts, presses, pushed_scenes
from benchmarks.options import Options
from benchmarks.report import met, table
from soro_core import load_robot
from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.control import Controller, ControllerConfig
from soro_core.control.reference.trajectory import Hold
from soro_core.estimation import Estimate, Estimator
from soro_core.loop import Loop
from tests.soro_core.loop.loop_harness import Harness, Setup

TITLE = "External force"
# The arm circles and learns, comes to rest, and is pushed for a while with each force [s], [N].
LEARN_S, REST_S, PUSH_S, PAUSE_S = 8.0, 1.5, 2.5, 2.0
FORCES_N = (0.05, 0.1, 0.2)
# The mean of the end of each push counts [s].
LAST_S = 1.0
PAYLOADS_KG, STIFFNESSES = (0.0, 0.02), (0.7, 1.0, 1.3)


class _Pushed:
    """A stepper with a force on the tip, held in the world within each step."""

    def __init__(self, plant: Harness) -> None:
        self.stepper, self.arm, self.force = plant.stepper, plant.arm, np.zeros(3)

    def step(self, state, pressure, dt):  # type: ignore[no-untyped-def]
        wrench = np.zeros(6)
        wrench[3:] = self.arm.pose(state.q, self.arm.length)[:3, :3].T @ self.force
        return self.stepper.step(state, pressure, dt, wrench=wrench)


def _pushed(payload_kg: float, stiffness: float, forces: tuple[float, ...]) -> list[list[str]]:
    """Return a row for each force."""
    robot, setup = load_robot("tue_three_bellow"), Setup(payload_kg=payload_kg, stiffness=stiffness)
    plant = Harness(robot, setup)
    world = plant.initial()
    stepper = plant.stepper = _Pushed(plant)
    control = with_changes(ControllerConfig(law="composite"), reference={"curvature_per_m": 6.0})
    loop = Loop(Estimator(robot, None, setup.dt), Controller(robot, control))
    state, setpoint, rows, reference = loop.initial_state(), np.zeros(robot.n_u), [], None
    first_s = LEARN_S + REST_S
    end_s = first_s + (PUSH_S + PAUSE_S) * len(forces)
    seen_at: dict[int, list[tuple[float, Estimate, Array]]] = {}
    for k in range(round(end_s / setup.dt)):
        t = k * setup.dt
        number, phase = divmod(t - first_s, PUSH_S + PAUSE_S)
        is_pushed = t >= first_s and phase < PUSH_S
        stepper.force = np.array([forces[int(number)] if is_pushed else 0.0, 0.0, 0.0])
        if k:
            world = plant.step_setpoints(world, setpoint)
        world, seen = plant.observe(world)
        state, estimate, command = loop.step(
            state, seen.reading_pa, seen.poses, seen.imus, setup.dt, reference
        )
        if t >= LEARN_S and reference is None:
            reference = Hold(estimate.q)
        if command.status.ok:
            setpoint = command.setpoint_pa
        if is_pushed:
            tip = plant.arm.pose(world.body.q, plant.arm.length)
            seen_at.setdefault(int(number), []).append((phase, estimate, tip))
    for number, force_n in enumerate(forces):
        rows.append(_row(payload_kg, stiffness, force_n, seen_at[number]))
    return rows


def _row(
    payload_kg: float, stiffness: float, force_n: float, seen: list[tuple[float, Estimate, Array]]
) -> list[str]:
    """Return what one push shows."""
    first = {one.external.stage: t for t, one, _ in reversed(seen) if one.external is not None}
    late = [(one, tip) for t, one, tip in seen if t > PUSH_S - LAST_S and one.external is not None]
    true, errors, inside = np.array([force_n, 0.0, 0.0]), [], []
    for one, tip in late:
        assert one.external is not None
        across = tip[:3, :2].T  # along the backbone little is known
        error, covariance = (
            across @ (one.external.force_n - true),
            across @ one.external.covariance @ across.T,
        )
        size = float(np.linalg.norm(error))
        along = error / size
        errors.append(error)
        inside.append(size < 2.0 * np.sqrt(along @ covariance @ along))
    mean = float(np.linalg.norm(np.mean(errors, axis=0)))
    tip_mm = 1e3 * float(
        np.linalg.norm(np.mean([one.tip_pose[:3, 3] - tip[:3, 3] for one, tip in late], axis=0))
    )
    goal = max(0.02 * force_n, 1e-3)
    return [
        f"{1e3 * payload_kg:g}",
        f"{stiffness:g}",
        f"{1e3 * force_n:g}",
        f"{1e3 * mean:.2f}",
        f"{100 * np.mean(inside):.0f} %",
        f"{tip_mm:.2f}",
        *(f"{first[stage]:.2f}" if stage in first else "-" for stage in ("outside force", "contact")),
        met(mean <= goal and np.mean(inside) >= 0.9 and tip_mm <= 0.15),
    ]


def run(options: Options) -> str:
    """Return the section.

    Parameters
    ----------
    options : Options
    """
    forces, rows, start = options.pick(FORCES_N, FORCES_N[:1]), [], time.perf_counter()
    for payload_kg, stiffness in options.pick(list(product(PAYLOADS_KG, STIFFNESSES)), [(0.0, 1.0)]):
        options.say(f"force: {1e3 * payload_kg:g} g, stiffness {stiffness:g}")
        rows += _pushed(payload_kg, stiffness, forces)
    header = [
        "load g",
        "stiffness",
        "force mN",
        "error mN",
        "within 2 deviations",
        "tip mm",
        "outside s",
        "contact s",
    ]
    note = (
        f"A lateral force on a resting arm of four pieces, after {LEARN_S:g} s of circles; the mean of the "
        f"last {LAST_S:g} s across the backbone. Goals: 2 % or 1 mN, 90 %, 0.15 mm."
    )
    goal = f"Pushes in scenes with other sensors. Goal: {100 * pushed_scenes.GOAL:g} % of the force."
    found = [note, table([*header, ""], rows), goal, pushed_scenes.section(options)]
    found += [presses.NOTE, presses.section(options)]
    if options.minutes:
        found += ["Nothing touches these arms:", false_contacts.section(options)]
    return "\n\n".join([*found, f"{time.perf_counter() - start:.0f} s"])
