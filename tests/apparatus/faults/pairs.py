"""Pairs of faults: a second one beside the first, in its vent or at the reset; what holds all the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.emulation.faults.fault_types import Injection
from tests.apparatus.faults.cells import BEFORE_S, EMPTY_PA, VENT_SLACK_S, command
from tests.apparatus.faults.matrix import MATRIX
from tests.apparatus.faults.rigs import Loop, Rig, rig_of
from tests.apparatus.faults.rows import Row

When: TypeAlias = Literal["beside", "vent", "latched", "reset"]
WHEN: tuple[When, ...] = ("beside", "vent", "latched", "reset")
Faults: TypeAlias = tuple[Injection, ...]
HEALTHY = Row("", "tolerate")
# Resets that a person tries when all is well again.
TRIES = 3
# How closely a healthy loop follows the circle.
FOLLOWS_PA = 9e3
# Time on the wall: in this process a device answers at once or never.
_SHORT = {"boot_timeout_s": 0.1, "sdo_timeout_s": 0.05, "activation_timeout_s": 0.2}


@dataclass(frozen=True)
class Pair:
    """Two rows of one family with their faults, and when the second comes: so long after what."""

    family: str
    rows: tuple[Row, Row]
    faults: tuple[Faults, Faults]
    when: When

    def __str__(self) -> str:
        first, second = ("; ".join(fault.as_text() for fault in faults) for faults in self.faults)
        return f"{self.family}: {first}, then ({self.when}) {second}"


def drawn(family: str, seed: int) -> Pair:
    """Two rows of a family on chambers, at times and for times that chance chooses."""
    rng = np.random.default_rng([seed, list(MATRIX).index(family)])
    rig = rig_of(family, HEALTHY)
    rig.close()
    rows = [row for row in MATRIX[family] if not row.bytes]
    first, second = (rows[n] for n in rng.integers(len(rows), size=2))
    faults = tuple(
        _placed(row, str(rng.choice(rig.regulator.chamber_names)), at, _sometimes(rng, 0.6))
        for row, at in ((first, 0.0), (second, _sometimes(rng, 0.4)))
    )
    return Pair(family, (first, second), (faults[0], faults[1]), WHEN[rng.integers(len(WHEN))])


def _sometimes(rng: np.random.Generator, most_s: float) -> float:
    return float(rng.choice([0.0, round(rng.uniform(0.02, most_s), 3)]))


def _placed(row: Row, chamber: str, at: float, duration_s: float) -> Faults:
    return tuple(
        fault.model_copy(
            update={
                "at": at,
                "duration_s": fault.duration_s or duration_s,
                "chamber": chamber if fault.chamber else "",
            }
        )
        for fault in row.injections()
    )


class Watched(Loop):
    """A loop that notes where a latched arm is not as it must be."""

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        self.problems: list[str] = []
        self._sent_pa: np.ndarray | None = None

    def cycle(self, command_pa: np.ndarray | None) -> None:
        was_vented, cause, before = self.vented, self.cause, self.exchange
        super().cycle(command_pa)
        if was_vented and (not self.vented or self.cause != cause):
            self.problems.append(f"the latch opened by itself, or says {self.cause!r} after {cause!r}")
        # The cycle in which a connection breaks may have sent something, and does not say what.
        had, self._sent_pa = self._sent_pa, None
        if self.exchange is None or self.exchange is before:
            return
        sent = self._sent_pa = self.exchange.sent_pa
        # A serial device has what it was sent last until its turn comes.
        if was_vented and had is not None and np.any((sent != 0.0) & (sent != had)):
            self.problems.append(f"sent {sent} after {had} while latched")

    def spin(self, seconds: float, pressed: bool = True, until_vented: bool = False) -> None:
        """Some time on the circle, or at zero."""
        end = self.cycles + round(seconds / self.rig.period_s)
        while self.cycles < end and not (until_vented and self.vented):
            wanted = self.wanted_pa()
            self.cycle(wanted if pressed else np.zeros_like(wanted))

    def wanted_pa(self, cycles_ago: int = 0) -> np.ndarray:
        """The circle now."""
        t = (self.cycles - cycles_ago) * self.rig.period_s
        return command(HEALTHY, t, self.rig.regulator.n_chambers)

    def inject(self, faults: Faults) -> None:
        """Add faults where the devices live."""
        for fault in faults:
            self.rig.at_devices(lambda fault=fault: self.rig.devices.faults.add(fault))


def run(pair: Pair) -> tuple[str, ...]:
    """What did not hold."""
    rig = rig_of(pair.family, HEALTHY)
    if isinstance(rig.platform, CanopenPlatform):
        times = rig.platform.canopen.model_copy(update=_SHORT)
        rig.regulator.platform = rig.platform.model_copy(update={"canopen": times})
    loop = Watched(rig)
    try:
        rig.regulator.configure()
        _judge(pair, loop)
    finally:
        rig.close()
    return tuple(dict.fromkeys(loop.problems))


def _judge(pair: Pair, loop: Watched) -> None:
    first, second = pair.faults
    loop.spin(BEFORE_S)
    loop.inject(first if pair.when != "beside" else first + second)
    loop.spin(1.5, until_vented=True)
    if loop.vented:
        loop.inject(second if pair.when == "vent" else ())
        _vents(pair, loop)
        if loop.reset() is None:
            loop.problems.append("reset while pressure was commanded")
    if pair.when == "latched":
        loop.inject(second)
        loop.spin(0.3)
    loop.spin(0.15, pressed=False)
    if pair.when == "reset":
        loop.inject(second)
    loop.reset()  # may be refused, or trip again
    loop.spin(0.5)
    _recovers(loop)


def _vents(pair: Pair, loop: Watched) -> None:
    """Every chamber that no fault blocks is below 5 kPa within the bound."""
    rig, start = loop.rig, loop.cycles
    if any(row.blocked == "arm" for row in pair.rows):
        loop.spin(0.5)
        return
    both = list(zip(pair.rows, pair.faults, strict=True))
    blocked = {fault.chamber for row, faults in both if row.blocked for fault in faults}
    free = [n for n, name in enumerate(rig.regulator.chamber_names) if name not in blocked]
    slower = float(np.prod([row.slower for row in pair.rows]))
    late_s = sum(row.late_s for row in pair.rows)
    late_s += pair.faults[1][0].at if pair.when == "vent" else 0.0
    highest = max(float(rig.devices.pressure_pa[free].max()), EMPTY_PA)
    bound_s = rig.vent_time(highest, EMPTY_PA, slower) + VENT_SLACK_S + late_s
    while (loop.cycles - start) * rig.period_s <= bound_s:
        if rig.devices.pressure_pa[free].max() < EMPTY_PA:
            return
        loop.spin(rig.period_s)
    left = rig.devices.pressure_pa[free].max() / 1e3
    loop.problems.append(f"still {left:.1f} kPa after {bound_s * 1e3:.0f} ms: {loop.cause}")


def _recovers(loop: Watched) -> None:
    """When all is well again the arm follows after a reset with a zero command, and not before."""
    rig, refusals = loop.rig, list[str]()
    rig.at_devices(rig.devices.faults.clear)
    loop.spin(0.4)  # a monitor may have started to see one of them
    while loop.vented and len(refusals) < TRIES:
        loop.spin(0.3, pressed=False)
        rig.at_devices(rig.mend)
        refusals += filter(None, [loop.reset()])
    loop.spin(0.8)
    if loop.vented:
        loop.problems.append(f"tripped again by {loop.cause}, or reset refused: {refusals}")
        return
    off_pa = np.abs(rig.devices.pressure_pa - loop.wanted_pa(cycles_ago=1)).max()
    if off_pa > FOLLOWS_PA:
        loop.problems.append(f"{off_pa / 1e3:.1f} kPa off after the reset")
