"""The loop of a scene without valves in one process, stamped and started as the nodes in lockstep.

`Loop.run` starts estimator and controller at the first tick with the same time. The estimator node takes its
first reading as the initial state and gives no estimate; the controller's time starts at the first estimate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from soro_core.config import with_changes
from soro_core.loop import certainty_of
from soro_core.safety import Limiter
from soro_core.twin import Twin
from soro_lab.scene import Scene
from soro_lab.scene.loop import loop_of


@dataclass(frozen=True)
class Step:
    """One tick: the true state, the estimate and the set points (None at the first tick)."""

    stamp_ns: int
    true_q: np.ndarray
    pressure_pa: np.ndarray
    tip: np.ndarray
    q: np.ndarray | None = None
    qd: np.ndarray | None = None
    setpoint_pa: np.ndarray | None = None
    wanted: np.ndarray | None = None  # position of the tip in the reference


def without_valves(scene: Scene) -> Scene:
    """The scene on the twin's own regulators, which are those that its platform emulates."""
    platform = scene.loaded_platform
    if platform is None:
        return scene
    twin = with_changes(scene.twin, regulator=platform.regulator)
    return with_changes(scene, platform="", twin=twin, faults=())


def lockstep(scene: Scene, ticks: int) -> Iterator[Step]:
    """Run a scene without platform for some ticks, as its nodes do in lockstep."""
    robot, loop = scene.loaded_robot, loop_of(scene)
    twin = Twin(robot, scene.twin_node())
    limiter = Limiter(scene.limits, robot.chamber_names, scene.regulator)
    period_ns = round(1e9 / scene.rate_hz)
    plant, seen = twin.observe(twin.initial())
    estimator = loop.estimator.initial_state(0.0, pressure_pa=seen.reading_pa)
    controller = loop.controller.initial_state()
    learned = None
    answer = Step(0, plant.arm.q, plant.air.pressure_pa, seen.tip[:3, 3])
    yield answer
    for tick in range(1, ticks):
        # The command that answers tick k - 1 acts from tick k on, so that of tick 0 never acts before tick 2.
        now_ns = (tick - 1) * period_ns
        limiter.slew(now_ns)
        limiter.judge(seen.reading_pa, True, now_ns)
        plant, seen = twin.observe(twin.step_setpoints(plant, limiter.state.setpoint_pa))
        stamp_ns = tick * period_ns
        if answer.setpoint_pa is not None:
            assert limiter.offer(answer.setpoint_pa, answer.stamp_ns, stamp_ns) is None
        poses = [_received(one) for one in seen.poses]
        imus = [_received(one) for one in seen.imus]
        dt = stamp_ns * 1e-9 - estimator.t_s
        estimator, estimate = loop.estimator.step(estimator, seen.reading_pa, poses, imus, dt, learned)
        assert estimate.status.ok
        t_s, dt = (stamp_ns - period_ns) * 1e-9, period_ns * 1e-9
        controller, command = loop.controller.step(
            controller,
            estimate.q,
            estimate.qd,
            t_s,
            dt,
            seen.reading_pa,
            certainty=certainty_of(estimate),
        )
        assert command.status.ok
        learned = command.learned
        answer = Step(
            stamp_ns,
            plant.arm.q,
            plant.air.pressure_pa,
            seen.tip[:3, 3],
            estimate.q,
            estimate.qd,
            command.setpoint_pa,
            command.tip_reference[:3, 3],
        )
        yield answer


def tip_error_rms_m(scene: Scene, first_s: float, last_s: float) -> float:
    """Return the distance of the tip from its reference between two times, RMS [m], without valves."""
    scene = without_valves(scene)
    first, last = (round(scene.rate_hz * at) for at in (first_s, last_s))
    steps = list(lockstep(scene, last + 1))[first:]
    return float(np.sqrt(np.mean([np.sum((step.tip - step.wanted) ** 2) for step in steps])))


def _received(sample: Any) -> Any:
    """A sample as the estimator node receives it: its stamp has whole nanoseconds."""
    return replace(sample, stamp_s=round(sample.stamp_s * 1e9) * 1e-9)
