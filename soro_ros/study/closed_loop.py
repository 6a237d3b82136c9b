"""The loop of a scene in lockstep in this process, without ROS: what `soro run` computes, and its recording.

Arm, estimator, controller and limiter are those of the nodes, stepped in their order at their times. Of a
platform the response of its regulators is computed, not its devices and their bus.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.control import Command
from soro_core.control.probing.stamps import StampedPosition
from soro_core.control.reference_feasibility import check_reach
from soro_core.errors import ConfigError, SoroError
from soro_core.estimation import Estimate, ImuSample, PoseSample
from soro_core.frozen import replaced
from soro_core.loop import certainty_of
from soro_core.robot import Robot
from soro_core.safety import Limiter
from soro_core.twin import Observation, Twin, TwinState
from soro_hardware.timing import rare_collections
from soro_lab.scene import Scene
from soro_lab.scene.loop import loop_of
from soro_ros.recordings.events import Event, NodeStatus
from soro_ros.recordings.recording import EMPTY, RunRecording, TopicSeries
from soro_ros.run.end import End
from soro_ros.status_words import NO_COMMAND, NO_ESTIMATE, add_prefix

Sample = TypeVar("Sample", PoseSample, ImuSample)


class RunTick(NamedTuple):
    """A tick: time since the first estimate [s], plant, sensors, estimate, and the answer of the law."""

    t_s: float
    plant: TwinState
    seen: Observation
    estimate: Estimate
    command: Command | None


def twin_of(scene: Scene, plant: Robot | None = None) -> Twin:
    """Return the simulated robot of a scene, without devices.

    Parameters
    ----------
    scene : Scene
    plant : Robot, optional
        The true robot, in place of what the scene says.

    Raises
    ------
    ConfigError
        If it cannot be simulated.
    """
    changes: dict[str, Any] = {"pressures": "regulators", "plant_link": "", "fault_link": ""}
    if scene.loaded_platform is not None:
        changes["regulator"] = scene.loaded_platform.regulator
    if plant is not None:
        changes["plant"] = ""
    return Twin(plant or scene.loaded_robot, with_changes(scene.twin_node(), **changes))


def ticks_of(scene: Scene, plant: Robot | None = None) -> Iterator[RunTick]:
    """Run the loop of a scene in lockstep; a command passes the limiter a tick after what it answers.

    A probe comes before the time of the scene, as in real time. Its parameters as in `twin_of`.

    Raises
    ------
    ConfigError
        If the scene does not fit its robot, or its reference cannot be reached.
    SoroError
        If the arm has no further step, the probe refuses it, or the limiter vents.
    """
    twin, loop = twin_of(scene, plant), loop_of(scene)
    controller = loop.controller
    if (reach := scene.controller_node().reach) > 0.0:
        check_reach(controller, reach)
    limiter = Limiter(scene.limits, scene.loaded_robot.chamber_names, twin.config.regulator)
    period_ns, first = round(1e9 * twin.dt), 0
    state, seen = twin.observe(twin.initial())
    # The first tick has no estimate.
    estimated = loop.estimator.initial_state(0.0, pressure_pa=seen.reading_pa)
    controlled, learned = controller.initial_state(), None
    due: Command | None = None
    answer: Command | None = None
    ticks, k = round(scene.duration_s * scene.rate_hz), -1
    while (k := k + 1) < ticks:
        if due is not None and due.status.ok:
            limiter.offer(due.setpoint_pa, (k - 1) * period_ns, k * period_ns, "controller")
        limiter.slew(k * period_ns)
        limiter.judge(seen.reading_pa, True, k * period_ns)
        if limiter.cause is not None:
            raise SoroError(f"{'regulator' if scene.platform else 'twin'}: vented: {limiter.cause}")
        state = twin.step_setpoints(state, limiter.state.setpoint_pa)
        if not state.status.ok:
            raise SoroError(f"twin: the twin stopped at {(k + 1) * twin.dt:.3f} s: {state.status}")
        state, seen = twin.observe(state)
        now_s = 1e-9 * ((k + 1) * period_ns)
        poses, imus = _stamped(seen.poses), _stamped(seen.imus)
        estimated, estimate = loop.estimator.step(
            estimated, seen.reading_pa, poses, imus, now_s - estimated.t_s, learned
        )
        due, answer, learned = answer, None, None
        if estimate.status.ok:
            first = first or k + 1
            t_s = 1e-9 * ((k + 1 - first) * period_ns)
            places = [
                StampedPosition(p.sensor, p.stamp_s - 1e-9 * first * period_ns, p.position) for p in poses
            ]
            controlled, answer = controller.step(
                controlled,
                estimate.q,
                estimate.qd,
                t_s,
                1e-9 * period_ns,
                seen.reading_pa,
                None,
                certainty_of(estimate),
                seen=places if controlled.probe is not None else [],
            )
            learned = answer.learned
            ticks += controlled.probe is not None
        yield RunTick(1e-9 * ((k + 1 - (first or k + 1)) * period_ns), state, seen, estimate, answer)
        if controlled.probe is not None and controlled.probe.done:
            raise SoroError(f"controller: {controlled.probe.refusal}")


def _stamped(samples: Sequence[Sample]) -> list[Sample]:
    """Return samples with the time of their messages, whole nanoseconds."""
    return [replaced(one, stamp_s=1e-9 * round(1e9 * one.stamp_s)) for one in samples]


def run_in_process(scene: Scene, plant: Robot | None = None) -> tuple[RunRecording, End]:
    """Run the loop of a scene; return what a recording of it has, and how it ended.

    Parameters
    ----------
    scene : Scene
    plant : Robot, optional
        The true robot, in place of what the scene says.
    """
    seen, end = _Recorder(scene), End()
    try:
        with rare_collections():
            for tick in ticks_of(scene, plant):
                seen.take(tick)
    except ConfigError as error:
        end = End(2, str(error))
    except SoroError as error:
        end = End(1, str(error))
    return seen.recording(end), end


class _Recorder:
    """Keeps of each tick what the report needs: a run takes some megabytes, whatever its ticks hold."""

    def __init__(self, scene: Scene) -> None:
        self._names = scene.loaded_robot.chamber_names
        self._rows: dict[str, list[tuple[float, Array]]] = {}
        self._said = list[NodeStatus]()
        self._last = {"controller": "", "estimator": ""}
        self._command: Command | None = None

    def take(self, tick: RunTick) -> None:
        """Note a tick."""
        command, estimate = tick.command, tick.estimate
        rows = {"true_tip": tick.seen.tip[:3, 3], "true_state": tick.plant.arm.q}
        rows["reading"] = tick.seen.reading_pa
        if estimate.status.ok:
            rows |= {"estimated_tip": estimate.tip_pose[:3, 3], "estimated_state": estimate.q}
        if command is not None and command.status.ok:
            rows["command"] = command.setpoint_pa
            if command.terms is not None:  # the law has begun
                rows["wanted_tip"] = command.tip_reference[:3, 3]
                if command.configured_tip is not None:
                    rows["configured_tip"] = command.configured_tip[:3, 3]
                self._command = command
        for name, row in rows.items():
            self._rows.setdefault(name, []).append((tick.t_s, np.array(row)))
        now = {"estimator": add_prefix(NO_ESTIMATE, estimate.status.message) or estimate.status.note}
        now["controller"] = NO_COMMAND
        if command is not None:
            now["controller"] = add_prefix(NO_COMMAND, command.status.message) or command.status.note
        changed = [(node, text) for node, text in now.items() if text != self._last[node]]
        self._said += [NodeStatus(tick.t_s, node, int(bool(text)), text) for node, text in changed]
        self._last = now

    def recording(self, end: End) -> RunRecording:
        """Return what was noted; times count from the first set point of the law."""
        start_s = self._rows["wanted_tip"][0][0] if "wanted_tip" in self._rows else 0.0

        def series(name: str, columns: tuple[str, ...] = ()) -> TopicSeries:
            if name not in self._rows:
                return EMPTY
            t, values = zip(*self._rows[name], strict=True)
            return TopicSeries(np.array(t) - start_s, np.array(values), columns)

        true_tip, faults = series("true_tip"), (end.error,) if end.status == 1 else ()
        node, _, text = end.error.partition(": ")
        trips = [Event(float(true_tip.t[-1]), "trip", node, text)] if faults and true_tip.t.size else []
        return RunRecording(
            true_tip=true_tip,
            estimated_tip=series("estimated_tip"),
            wanted_tip=series("wanted_tip"),
            configured_tip=series("configured_tip"),
            command=series("command", self._names),
            reading=series("reading", self._names),
            estimates=self._learned(start_s, "estimates"),
            deviations=self._learned(start_s, "deviations"),
            diagnostics={},
            faults=faults,
            true_state=series("true_state"),
            estimated_state=series("estimated_state"),
            events=tuple(trips),
            said=tuple(one._replace(t_s=one.t_s - start_s) for one in self._said),
        )

    def _learned(self, start_s: float, which: str) -> TopicSeries:
        """Return what the law had learned at its end, one sample: its numbers, or their deviations."""
        command = self._command
        if command is None:
            return EMPTY
        numbers = command.estimates if which == "estimates" else command.deviations()
        at = np.array([self._rows["wanted_tip"][-1][0] - start_s])
        return TopicSeries(at, np.array([list(numbers.values())]), tuple(numbers)) if numbers else EMPTY
