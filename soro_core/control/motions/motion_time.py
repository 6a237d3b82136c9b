"""Time that the parts of a motion need to keep rates of strain and of set points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.control.config import ControllerConfig
from soro_core.control.motions.motion_parts import MotionSegment, Slower, ToRest
from soro_core.control.motions.pressure_feasibility import PressureSupply, Rates, rates
from soro_core.control.reference.reference_transition import Bounds
from soro_core.planning.motion_error import MotionError
from soro_core.planning.steps import Planning

ON_THE_WAY = "on the way to the first pose"
# Samples of a part at which rates of strain and the speed of the tip are taken.
_SAMPLES = 64
# What rates may be between two samples, relative to the largest sample.
_BETWEEN = 1.01
# Samples in one step of the plan.
_IN_A_STEP = 8
# Times that the way to the path is extended by a third.
_LONGER = 12
# A search for the factor of time is given up beyond so many times the largest one.
_HOPELESS = 10.0
# A search for the factor of time ends within this part of the smallest one.
_PRECISION = 0.03


@dataclass(frozen=True)
class Timing:
    """Searches of the time of a part; attributes as those of `soro_core.control.motions.motion.Planner`."""

    supply: PressureSupply
    bounds: Bounds
    config: ControllerConfig
    dt: float

    def longer(self, part_of: Callable[[float], ToRest], duration_s: float) -> Planning[ToRest]:
        """Find a duration [s] from `duration_s` on at which a part keeps its rates."""
        for _ in range(_LONGER):
            part = part_of(duration_s)
            found = yield from rates(self.supply, part, self.dt, self.config.motion.rate_part)
            _, _, rate = yield from self.peaks(part)
            if found.rate <= 1.0 and rate <= 1.0:
                return part
            duration_s *= 1.3
        raise self._too_fast(found, rate, ON_THE_WAY, None)

    def peaks(self, part: MotionSegment, samples: int = _SAMPLES) -> Planning[tuple[float, float, float]]:
        """Find the largest speed [m/s] and acceleration [m/s^2] of the tip, and rate over the allowed one.

        Parameters
        ----------
        part : MotionSegment
        samples : int
            Pieces of its time, between whose ends they are taken.
        """
        arm, bounds = self.supply.arm, self.bounds
        times = np.linspace(0.0, part.duration_s, samples + 1)
        speeds, rate = [], []
        for k, t in enumerate(times):
            point = part.at(float(t))
            pose, jacobian = arm.pose_and_jacobian(point.q, arm.length)
            speeds.append(pose[:3, :3] @ (jacobian[3:] @ point.qd))
            rate.append(point.qd)
            if k % _IN_A_STEP == 0:
                yield
        change = np.diff(np.array(speeds), axis=0) / times[1]
        return (
            float(np.max(np.linalg.norm(speeds, axis=1))),
            float(np.max(np.linalg.norm(change, axis=1))),
            _BETWEEN * float(np.max(bounds.fields.peaks(np.array(rate)) / bounds.rate)),
        )

    def factor(self, path: Sequence[MotionSegment]) -> Planning[float]:
        """Find the smallest factor of time with which strains, pressures and set points keep their rates."""
        if not path:
            return 1.0
        share, most = self.config.motion.rate_part, self.config.motion.slowest
        strain = 0.0
        for part in path:
            _, _, rate = yield from self.peaks(part)
            strain = max(strain, rate)
        low, factor, high, worst = 0.0, max(1.0, strain), np.inf, Rates(0.0, 0, 0.0, 0.0, False)
        while True:
            found = yield from self._worst(path, factor, share)
            if found.fits:
                if low == 0.0 or factor <= low * (1.0 + _PRECISION):
                    break
                high = factor
            else:
                low, worst = factor, found
                if low > _HOPELESS * most:
                    raise self._too_fast(worst, strain, "path", None)
            # Rates fall at least as the factor grows; the rise of a set point falls faster.
            factor = 0.5 * (low + high) if np.isfinite(high) else low * min(max(found.rate, 1.1), 2.0)
        if factor > most:
            raise self._too_fast(worst, strain, "path", factor)
        return float(factor)

    def _worst(self, path: Sequence[MotionSegment], factor: float, share: float) -> Planning[Rates]:
        """Find the rates of the part that keeps them least."""
        found: list[Rates] = []
        for part in path:
            found.append((yield from rates(self.supply, Slower(part, factor), self.dt, share)))
        return max(found, key=lambda one: (not one.fits, one.rate))

    def _too_fast(self, found: Rates, strain: float, where: str, factor: float | None) -> MotionError:
        name = self.supply.arm.robot.chamber_names[found.chamber]
        got = f"{found.rate:.2f} times the allowed change of the set point of {name}, {where}"
        if found.fits or found.rate <= 1.0 < strain:
            got = f"{strain:.2f} times the allowed rate of strain, {where}"
        works = "none works" if factor is None else f"the smallest that works is {factor:.2f}"
        allowed = f"a factor of time of at most {self.config.motion.slowest:g} (motion.slowest); {works}"
        return MotionError("rate", "rate", got, allowed, chamber=name, factor=factor)
