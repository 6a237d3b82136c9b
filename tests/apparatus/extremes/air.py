"""Runs of the table of extremes on the air: the flow as pressures meet, volumes that the arm changes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from soro_core import SoftArm, simulate
from soro_core.integrate import Result
from soro_core.pneumatics import ValveModel, chamber_pressures, make_gas, masses_at
from soro_core.pneumatics.chamber import AMBIENT_PA
from tests.apparatus.extremes.arms import FULL_SCALE_PA, Arm, least_stretch
from tests.apparatus.extremes.cell import Outcome, Verdict, stopped
from tests.apparatus.extremes.measure import DEFAULT, SWING, scale_of

STEPS = 2000
# Of the pressure, for round-off.
BEYOND = 1e-12


@dataclass(frozen=True)
class Meet:
    """A chamber filled or vented through an orifice until its pressure meets that behind it."""

    volume_m3: float
    dt: float
    start_pa: float
    setpoint_pa: float
    goal_pa: float
    """Where the pressure has to go, and which it must not pass."""
    valve: ValveModel = field(default_factory=ValveModel)

    def __call__(self) -> Verdict:
        """Run and judge."""
        volume, setpoint = np.full(1, self.volume_m3), np.full(1, self.setpoint_pa)
        gas = make_gas(self.valve, volume)
        mass, slope, p = np.empty(1), np.empty(1), np.full(1, self.start_pa)
        masses_at(gas, p, volume, mass)
        path = [self.start_pa]
        for _ in range(STEPS):
            after = np.empty(1)
            if not chamber_pressures(gas, mass, volume, volume, setpoint, self.dt, after, p, slope):
                return Verdict(Outcome.NONSENSE, "refused")
            mass = after
            path.append(float(p[0]))
        way = np.array(path) * np.sign(self.goal_pa - self.start_pa)
        goal = self.goal_pa * np.sign(self.goal_pa - self.start_pa)
        if not np.isfinite(way).all():
            return Verdict(Outcome.NONSENSE, "not finite")
        allowed = BEYOND * gas.supply
        beyond, back = float(way.max() - goal), float(np.diff(way).min())
        good = beyond <= allowed and back >= -allowed
        note = (
            f"{abs(goal - way[-1]):.0e} Pa short, {max(beyond, 0.0):.0e} beyond, {max(-back, 0.0):.0e} back"
        )
        return Verdict(Outcome.FINISHED if good else Outcome.NONSENSE, note)


@dataclass(frozen=True)
class Breathe:
    """An arm let go with air in its chambers, whose volume it changes: shut in, or with valves that step."""

    arm: Arm
    turns: float
    dt: float
    steps: int = 100
    shut: bool = True
    setpoint: float = 0.0
    """Of full scale, in the first chamber of each link; none in the others."""
    polytropic: float = 1.0

    def __call__(self) -> Verdict:
        """Run and judge."""
        robot = self.arm.robot()
        arm = SoftArm(robot)
        q0 = self.arm.coordinates(robot, 2.0 * np.pi * self.turns / self.arm.length)
        wanted = np.zeros(arm.n_u)
        wanted[::3] = self.setpoint * FULL_SCALE_PA
        conductance = 0.0 if self.shut else 1e-9
        valves = ValveModel(fill_m3_s_pa=conductance, vent_m3_s_pa=conductance, polytropic=self.polytropic)
        result = simulate(
            arm,
            q0,
            t_end=self.steps * self.dt,
            dt=self.dt,
            integrator=DEFAULT,
            pressure=wanted,
            valves=valves,
        )
        if not (np.isfinite(result.q).all() and np.isfinite(result.pressure).all()):
            return Verdict(Outcome.NONSENSE, "not finite")
        if least_stretch(arm, result.q) <= 0.0:
            return Verdict(Outcome.NONSENSE, "elongation of -1 or less")
        if not result.status.ok:
            return stopped(result.status)
        if not self.shut:
            short = float(np.abs(result.pressure[-1] - wanted).max())
            good = short <= 1e-2 * FULL_SCALE_PA
            return Verdict(Outcome.FINISHED if good else Outcome.NONSENSE, f"{short:.0e} Pa off")
        gain = self._gain(arm, result)
        good = gain <= SWING
        return Verdict(Outcome.FINISHED if good else Outcome.NONSENSE, f"gained {gain:.0e}")

    def _gain(self, arm: SoftArm, result: Result) -> float:
        """Most that the energy of arm and air rose, over what the arm had and its weight can give."""
        rest = arm.tables.axial_gain.sum(axis=0)
        own = np.array([sum(arm.energy(q, qd)) for q, qd in zip(result.q, result.qd, strict=True)])
        volume = rest + np.array([arm.displaced_volume(q) for q in result.q])
        absolute, n = result.pressure + AMBIENT_PA, self.polytropic
        inside = -absolute * volume * np.log(volume / rest) if n == 1.0 else absolute * volume / (n - 1.0)
        total = own + (inside + AMBIENT_PA * volume).sum(axis=1)
        return float(total.max() - total[0]) / scale_of(arm, result)
