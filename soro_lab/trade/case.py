"""The simulated case: a robot, its start, and its pressures over time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Robot, refuse_tendons, strain_rows
from soro_core.robot.coordinates import strain_fields
from soro_lab.identification import ForcedRun, read_forced
from soro_lab.scene import Scene
from soro_lab.trade.closed_loop import drive

SAMPLE_S = 0.02  # of all traces; time steps divide it
TICK_S = 0.005
RISE_S = 0.02
FREE_BEND_RAD = 1.0


@dataclass(frozen=True)
class TradeCase:
    """A run that every candidate computes; it can be pickled.

    Attributes
    ----------
    robot : Robot
        The robot of the robot file.
    text : str
        Description of the excitation.
    knots_s, pressure_pa : ndarray (n,), (n, n_u)
        Times [s] and pressures [Pa gauge], linear between the knots and constant beyond them.
    t_end : float
        Duration [s].
    tick_s : float
        Period whose longest computation is reported [s].
    paced : bool
        Whether equal steps fill each tick, so that no step is longer than a tick.
    start : mapping of strain to value, or None
        Uniform initial strain of all links, at rest; None: equilibrium under the first pressures.
    scene : Scene or None
        Scene of the case, for the closed loop.
    measured : ForcedRun or None
        Recorded run to compare with.
    """

    robot: Robot
    text: str
    knots_s: Array
    pressure_pa: Array
    t_end: float
    tick_s: float = TICK_S
    paced: bool = False
    start: Mapping[str, float] | None = None
    scene: Scene | None = None
    measured: ForcedRun | None = field(default=None, repr=False)

    @property
    def longest_step_s(self) -> float:
        """Longest step that fits into a tick [s]; infinite if the case is not paced."""
        if not self.paced:
            return math.inf
        return self.tick_s if self.scene is None else min(self.tick_s, 1.0 / self.scene.rate_hz)

    def step_s(self, dt_s: float) -> float:
        """Return the step [s], at most `dt_s` [s], of which a whole number fills a tick."""
        if not self.paced:
            return dt_s
        return self.tick_s / max(1, math.ceil(self.tick_s / dt_s - 1e-9))

    def pressures(self, times: Array) -> Array:
        """Return pressures (n_t, 3, n_u) [Pa gauge] at start, middle and end of the steps from `times`."""
        after = np.append(times[1:], times[-1])
        table = np.empty((len(times), 3, self.robot.n_u))
        for stage, at in enumerate((times, 0.5 * (times + after), after)):
            for u in range(self.robot.n_u):
                table[:, stage, u] = np.interp(at, self.knots_s, self.pressure_pa[:, u])
        return table

    def initial(self, arm: SoftArm) -> Array:
        """Return the coordinates (n_q,) at the start, in the shape functions of `arm`.

        Raises
        ------
        ModelError
            If there is no equilibrium.
        """
        if self.start is None:
            return equilibrium(arm, self.pressure_pa[0])
        # POD modes have no constant mode: use the least-squares projection of the uniform strain.
        uniform = strain_fields(arm.robot).uniform
        names = [name for link in arm.robot.links for name in strain_rows(link)]
        return uniform * [self.start.get(name, 0.0) for name in names]


def bare_case(robot: Robot, seconds: float = 1.0) -> TradeCase:
    """Return the standard run of a robot without a scene.

    With chambers: from rest, the first chamber of each link rises to half of the robot's range of pressure
    within 20 ms, after a third of the time the second one, and after two thirds both are released. Without
    chambers: release from a uniform bend of 1 rad in total.
    """
    refuse_tendons(robot, "trade")
    if not robot.n_u:
        bending = [name for name in ("bending_x", "bending_y") if name in robot.links[0].strains]
        start: dict[str, float] = {bending[0]: FREE_BEND_RAD / robot.length} if bending else {}
        if not start:
            raise ModelError(f"{robot.name} has neither chambers nor bending: nothing would move it")
        none = np.zeros((1, 0))
        modes = not all(link.splits for link in robot.links)
        near = ", as near as its modes allow" if modes else " in total"
        text = f"release from a uniform bend of {FREE_BEND_RAD:g} rad{near}; {seconds:g} s"
        return TradeCase(robot, text, np.zeros(1), none, seconds, start=start)
    low, high = robot.pressure_range_pa
    half = 0.5 * (max(low, 0.0) + high)
    first = np.zeros(robot.n_u)
    second = np.zeros(robot.n_u)
    for u, name in enumerate(robot.chamber_names):
        number = int(name.rsplit("chamber", 1)[1])
        first[u] = half * (number == 0)
        second[u] = half * (number <= 1)
    third = SAMPLE_S * round(seconds / 3.0 / SAMPLE_S)
    rest = np.zeros(robot.n_u)
    knots = np.array([0.0, RISE_S, third, third + RISE_S, 2 * third, 2 * third + RISE_S])
    table = np.array([rest, first, first, second, second, rest])
    text = (
        f"from rest, the first chamber of each link to {half / 1e3:g} kPa, the second too at {third:g} s, "
        f"all released at {2 * third:g} s, each within {1e3 * RISE_S:g} ms; {seconds:g} s"
    )
    return TradeCase(robot, text, knots, table, seconds)


def scene_case(scene: Scene, seconds: float = 4.0) -> TradeCase:
    """Return the run of a scene: the pressures of its closed loop in simulation, from rest.

    Estimator and controller with the robot of the robot file control the twin of the scene once. Every
    candidate gets the chamber pressures of that run in open loop.

    Raises
    ------
    ConfigError
        If robot, controller or measured run cannot be used.
    ModelError
        If the twin fails.
    """
    robot = scene.loaded_robot
    measured = read_forced(scene.measured) if scene.measured else None
    plain = scene.with_keys(model=None)
    if not robot.n_u:
        case = bare_case(robot, seconds)
        return replace(case, scene=plain, tick_s=1.0 / scene.rate_hz, paced=True, measured=measured)
    record = drive(plain, plain.discretisation, seconds=seconds)
    every = max(1, round(SAMPLE_S * scene.rate_hz))
    text = (
        f"from rest, the chamber pressures that the loop of scene {scene.name} makes in simulation "
        f"(as its file has the robot), open loop; {seconds:g} s"
    )
    return TradeCase(
        robot,
        text,
        record.t[::every],
        record.pressure_pa[::every],
        seconds,
        tick_s=1.0 / scene.rate_hz,
        paced=True,
        scene=plain,
        measured=measured,
    )
