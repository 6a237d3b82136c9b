"""Findings of a first pressurisation from its measurements, with advice; pure functions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.pneumatics.regulator import RegulatorModel, initial_state, step, vent_time
from soro_hardware.doctor import check_offsets
from soro_hardware.finding import Finding
from soro_hardware.hil.bending import Bending
from soro_hardware.hil.measured import PressureHold, RestReadings, Vent

# Largest error of a level: absolute [Pa], plus a part of the set point.
LEVEL_PA, LEVEL_PART = 500.0, 0.05
# A reading below this part of the expected one has not followed; another chamber above it has.
FOLLOWED, OTHER_FOLLOWED = 0.4, 0.4
# Largest change of another chamber: absolute [Pa], plus a part of the set point.
CROSSTALK_PA, CROSSTALK_PART = 400.0, 0.05
DRIFT_PA_S, DRIFT_ERRORS = 300.0, 5.0
# Longest time of a rise or a vent: this factor of the model's, plus a constant [s].
SLOWER, SLOWER_S = 2.5, 0.05

# What to do about a trip of the limiter, by the first words of its cause.
TRIP_STEPS = {
    "over-pressure": "the valve lets the supply through, or the scale is wrong: supply off, then look",
    "open circuit": "check the sensor's cable",
    "short circuit": "check the sensor's cable",
    "stuck valve": "check the valve's cable and supply pressure, and the line before the sensor",
    "frozen sensor": "check the sensor; the device sends old values",
    "leak": "look for the leak: fittings first, then the chamber",
    "supply high": "lower the supply pressure at its reducer, and look at the relief valve",
    "supply low": "raise the supply pressure, or mend its line",
    "spike": "check the sensor's cable and earth",
    "implausible": "check the sensor's zero and scale; a slow valve needs its lag in the platform file",
    "readings lost": "check the bus: soro doctor",
}


@dataclass(frozen=True)
class Expectation:
    """Behaviour of a healthy platform.

    Attributes
    ----------
    names : tuple of str
        Names of the chambers.
    steps_pa : tuple of float
        Set points of each chamber [Pa gauge].
    response : RegulatorModel
        Response of the regulators.
    rise_pa_s : float
        Rise of the set points [Pa/s].
    update_s : float
        Time between two exchanges of a chamber [s].
    bending : Bending or None
        Motion of the tip, if a robot is given.
    """

    names: tuple[str, ...]
    steps_pa: tuple[float, ...]
    response: RegulatorModel
    rise_pa_s: float
    update_s: float
    bending: Bending | None = None

    def level_pa(self, setpoint_pa: float) -> float:
        """Return the final pressure [Pa gauge] for a set point, from below."""
        state = step(self.response, initial_state(self.response, 1), np.array([setpoint_pa]), 1e3)
        return float(state.pressure_pa[0])

    def rise_s(self, change_pa: float) -> float:
        """Return the time to 63 % of a step [s]: dead time, lag, ramp of the limiter, and updates."""
        ramp = change_pa / self.rise_pa_s
        return self.response.delay_s + self.response.tau_s + 0.63 * ramp + 3 * self.update_s


def judge_rest(names: tuple[str, ...], rest: RestReadings) -> list[Finding]:
    """Return the findings of the readings at rest."""
    return check_offsets(names, rest.mean_pa, rest.noise_pa)


def judge_trip(where: str, cause: str) -> Finding:
    """Return the finding of a trip of the limiter."""
    advice = next((do for word, do in TRIP_STEPS.items() if cause.startswith(word)), "see docs/safety.md")
    return Finding(f"{where}: limiter", "fail", f"vented: {cause}", advice)


def judge_holds(expected: Expectation, holds: Sequence[PressureHold]) -> list[Finding]:
    """Return the findings of the steps of one chamber so far; a failure omits findings that depend on it."""
    if not holds:
        return []
    findings = [_follows(expected, holds)]
    if findings[0].level == "fail":
        return findings
    findings.append(_speed(expected, holds))
    if findings[1].level != "fail":
        findings += [_level(expected, holds), _drift(expected, holds)]
    findings.append(_others(expected, holds))
    return findings


def judge_vent(expected: Expectation, vent: Vent) -> Finding:
    """Return the finding of a vent: whether the chambers are empty, and how fast."""
    name = f"{expected.names[vent.chamber]}: vent"
    worst = int(np.nanargmax(np.nan_to_num(vent.end_pa, nan=np.inf)))
    if math.isnan(vent.took_s):
        found = f"{expected.names[worst]} keeps {vent.end_pa[worst] / 1e3:.1f} kPa"
        return Finding(name, "fail", found, "supply off, open the dump valve; the exhaust is blocked or slow")
    start = float(vent.from_pa[vent.chamber])
    usual = vent_time(expected.response, max(start, vent.low_pa), vent.low_pa) + 2 * expected.update_s
    found = f"from {start / 1e3:.1f} to below {vent.low_pa / 1e3:.1f} kPa in {vent.took_s * 1e3:.0f} ms"
    if vent.took_s > SLOWER * usual + SLOWER_S:
        text = f"{found}, expected {usual * 1e3:.0f} ms"
        return Finding(name, "warn", text, "a kinked line or a narrow exhaust: the arm empties late")
    return Finding(name, "ok", found)


def _follows(expected: Expectation, holds: Sequence[PressureHold]) -> Finding:
    """Return whether the reading of the commanded chamber rises with the set point."""
    last = holds[-1]
    k, name = last.chamber, f"{expected.names[last.chamber]}: rises"
    wanted = expected.level_pa(last.setpoint_pa)
    level, others = float(last.level_pa[k]), np.delete(np.arange(last.level_pa.size), k)
    found = f"reads {level / 1e3:+.2f} kPa at a set point of {last.setpoint_pa / 1e3:g} kPa"
    if level >= FOLLOWED * wanted:
        return Finding(name, "ok", found)
    moved = others[last.level_pa[others] >= OTHER_FOLLOWED * wanted]
    if moved.size:
        other = ", ".join(expected.names[n] for n in moved)
        text = f"{found}, and {other} {last.level_pa[moved[0]] / 1e3:+.2f} kPa"
        return Finding(
            name, "fail", f"swapped: {text}", "lines or channels are swapped: platform file, then tubes"
        )
    if level <= -FOLLOWED * wanted:
        return Finding(name, "fail", f"wrong sign: {found}", "the reading's scale has the wrong sign")
    if last.drift_pa_s > max(DRIFT_PA_S / 3, DRIFT_ERRORS * last.drift_error_pa_s):
        text = f"slow: {found}, rising by {last.drift_pa_s / 1e3:.2f} kPa/s"
        return Finding(name, "fail", text, "the line is kinked or narrow, or the valve slow")
    return Finding(
        name, "fail", f"does not rise: {found}", "valve closed, no supply, or the line is off or burst"
    )


def _speed(expected: Expectation, holds: Sequence[PressureHold]) -> Finding:
    """Return the finding of the slowest step, relative to its expected time to 63 %."""
    name = f"{expected.names[holds[0].chamber]}: speed"
    before, slowest = 0.0, (0.0, 0.0, 0.0, 0.0)
    for hold in holds:
        usual = expected.rise_s(hold.setpoint_pa - before)
        from_pa, before = before, hold.setpoint_pa
        took = math.inf if math.isnan(hold.t63_s) else hold.t63_s
        slowest = max(slowest, (took / usual, took, usual, from_pa))
    ratio, took, usual, from_pa = slowest
    found = f"63 % of the step from {from_pa / 1e3:g} kPa after {took * 1e3:.0f} ms"
    found += f", expected {usual * 1e3:.0f} ms"
    last = holds[-1]
    rising = _drifts(last) and last.drift_pa_s > 0 and last.level_pa[last.chamber] < last.setpoint_pa
    if ratio > SLOWER or rising:
        text = f"slow: {found}"
        text += f"; still rising by {last.drift_pa_s / 1e3:.2f} kPa/s" if rising else ""
        return Finding(name, "fail", text, "the line is kinked or narrow, or the valve slow")
    return Finding(name, "ok", found)


def _level(expected: Expectation, holds: Sequence[PressureHold]) -> Finding:
    """Return the finding of the level of the last step, relative to the level that the model expects."""
    last = holds[-1]
    name = f"{expected.names[last.chamber]}: level"
    wanted, level = expected.level_pa(last.setpoint_pa), float(last.level_pa[last.chamber])
    found = f"{level / 1e3:.2f} kPa at {last.setpoint_pa / 1e3:g} kPa, expected {wanted / 1e3:.2f} kPa"
    if abs(level - wanted) <= LEVEL_PA + LEVEL_PART * wanted:
        return Finding(name, "ok", found)
    if level < wanted:
        return Finding(
            name,
            "fail",
            f"low: {found}",
            "a leak that exceeds the regulator's flow (listen, spray), else the scale",
        )
    return Finding(name, "fail", f"high: {found}", "the scale of reading or set point, or the valve's gain")


def _drift(expected: Expectation, holds: Sequence[PressureHold]) -> Finding:
    """Return the finding of the drift of readings at a constant set point."""
    worst = max(holds, key=lambda hold: abs(hold.drift_pa_s))
    name = f"{expected.names[worst.chamber]}: leak"
    found = f"{worst.drift_pa_s / 1e3:+.2f} kPa/s at a constant {worst.setpoint_pa / 1e3:g} kPa"
    if not _drifts(worst):
        return Finding(name, "ok", found)
    if worst.drift_pa_s < 0:
        return Finding(name, "fail", f"leak: {found}", "look for the leak: fittings first, then the chamber")
    return Finding(name, "fail", f"creeps up: {found}", "the valve lets air pass, or it has not settled")


def _drifts(hold: PressureHold) -> bool:
    return abs(hold.drift_pa_s) > max(DRIFT_PA_S, DRIFT_ERRORS * hold.drift_error_pa_s)


def _others(expected: Expectation, holds: Sequence[PressureHold]) -> Finding:
    """Return the finding of the readings of the other chambers."""
    k = holds[0].chamber
    name = f"{expected.names[k]}: others"
    others = np.delete(np.arange(len(expected.names)), k)
    if not others.size:
        return Finding(name, "ok", "there are none")
    last = holds[-1]
    n = int(others[np.argmax(np.abs(last.level_pa[others]))])
    found = f"{expected.names[n]} changes by {last.level_pa[n] / 1e3:+.2f} kPa"
    if abs(last.level_pa[n]) > CROSSTALK_PA + CROSSTALK_PART * last.setpoint_pa:
        return Finding(name, "fail", f"crosstalk: {found}", "chambers or lines are connected, or swapped")
    return Finding(name, "ok", f"at most: {found}")
