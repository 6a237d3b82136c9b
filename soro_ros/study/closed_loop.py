"""The loop of a scene in lockstep in this process, without ROS: what `soro run` computes, and its recording.

The arm, the estimator, the controller and the limiter are the nodes' own, stepped in their order. Of a
platform the response of its regulators is computed, not its devices and their bus: set points and readings
are not rounded to what a device sends, and no fault of one can be injected.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.control.reference_feasibility import check_reach
from soro_core.errors import ConfigError, SoroError
from soro_core.loop import Tick
from soro_core.robot import Robot
from soro_core.safety import Limiter
from soro_core.twin import Observation, Twin, TwinState
from soro_core.twin.config import described_plant
from soro_lab.scene import Scene
from soro_lab.scene.loop import loop_of
from soro_ros.recordings.events import Event, NodeStatus
from soro_ros.recordings.recording import EMPTY, RunRecording, TopicSeries
from soro_ros.run.end import End
from soro_ros.status_words import NO_COMMAND, NO_ESTIMATE, add_prefix


class LimitedTwin:
    """The twin of a scene behind the limiter: a command acts a tick after the tick that it answers.

    Parameters
    ----------
    scene : Scene
    plant : Robot, optional
        The true robot, in place of what the scene says.
    """

    def __init__(self, scene: Scene, plant: Robot | None = None) -> None:
        changes: dict[str, Any] = {"pressures": "regulators", "plant_link": "", "fault_link": ""}
        if scene.loaded_platform is not None:
            changes["regulator"] = scene.loaded_platform.regulator
        if plant is not None:
            changes["plant"] = ""
        config = with_changes(scene.twin_node(), **changes)
        self._twin = Twin(scene.loaded_robot if plant is None else plant, config)
        self.dt = self._twin.dt
        self.limiter = Limiter(scene.limits, scene.loaded_robot.chamber_names, config.regulator)
        self._period_ns = round(1e9 * self.dt)
        self._answers: deque[Array | None] = deque()

    def initial(self) -> TwinState:
        """Return the state at the first tick."""
        return self._twin.initial()

    def observe(self, state: TwinState) -> tuple[TwinState, Observation]:
        """Sample the sensors; called once a tick."""
        state, seen = self._twin.observe(state)
        self._reading_pa = seen.reading_pa
        return state, seen

    def take(self, tick: Tick[TwinState, Observation]) -> None:
        """Take the command of a tick, if it has one; called once a tick."""
        self._answers.append(tick.command.setpoint_pa if tick.command.status.ok else None)

    def step_setpoints(self, state: TwinState, setpoint_pa: Array) -> TwinState:
        """Advance by one tick with the commands that were taken, behind the limiter."""
        now_ns = state.tick * self._period_ns
        command = self._answers.popleft() if state.tick > 0 else None
        if command is not None:
            self.limiter.offer(command, now_ns - self._period_ns, now_ns, "controller")
        self.limiter.slew(now_ns)
        self.limiter.judge(self._reading_pa, True, now_ns)
        return self._twin.step_setpoints(state, self.limiter.state.setpoint_pa)


def ticks_of(scene: Scene, plant: Robot | None = None) -> Iterator[Tick[TwinState, Observation]]:
    """Run the loop of a scene in lockstep; it ends early when the limiter has vented.

    Parameters
    ----------
    scene : Scene
    plant : Robot, optional
        The true robot, in place of what the scene says.

    Raises
    ------
    ConfigError
        If the scene does not fit its robot, or its reference cannot be reached.
    SoroError
        If the arm has no further step, the probe refuses it, or the limiter vents.
    """
    node = "regulator" if scene.platform else "twin"
    twin, loop = LimitedTwin(scene, plant), loop_of(scene)
    if (reach := scene.controller_node().reach) > 0.0:
        check_reach(loop.controller, reach)
    for tick in loop.run(twin, round(scene.duration_s * scene.rate_hz), twin.dt, before_s=-twin.dt):
        twin.take(tick)
        yield tick
        command = tick.command
        if command.status.ok and command.terms is None and not command.status.note.startswith("probing"):
            raise SoroError(f"controller: {command.status.note}")
        if twin.limiter.cause is not None:
            raise SoroError(f"{node}: vented: {twin.limiter.cause}")


def plant_of(scene: Scene) -> Robot:
    """Return the robot whose file describes the true arm."""
    return described_plant(scene.loaded_robot, scene.twin_node())


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

    def take(self, tick: Tick[TwinState, Observation]) -> None:
        """Note a tick."""
        command, estimate = tick.command, tick.estimate
        rows = {
            "true_tip": tick.seen.tip[:3, 3],
            "true_state": tick.plant.arm.q,
            "reading": tick.seen.reading_pa,
        }
        if estimate.status.ok:
            rows |= {"estimated_tip": estimate.tip_pose[:3, 3], "estimated_state": estimate.q}
        if command.status.ok:
            rows["command"] = command.setpoint_pa
            if command.terms is not None:  # the law has begun
                rows["wanted_tip"] = command.tip_reference[:3, 3]
        for name, row in rows.items():
            self._rows.setdefault(name, []).append((tick.t_s, np.array(row)))
        now = {
            "controller": add_prefix(NO_COMMAND, command.status.message) or command.status.note,
            "estimator": add_prefix(NO_ESTIMATE, estimate.status.message) or estimate.status.note,
        }
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
            command=series("command", self._names),
            reading=series("reading", self._names),
            estimates=EMPTY,
            diagnostics={},
            faults=faults,
            true_state=series("true_state"),
            estimated_state=series("estimated_state"),
            events=tuple(trips),
            said=tuple(one._replace(t_s=one.t_s - start_s) for one in self._said),
        )
