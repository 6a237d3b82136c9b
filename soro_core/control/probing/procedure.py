"""The probe, tick by tick: a state machine that gives set points until it has its findings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from soro_core.arrays import Array
from soro_core.control.probing.dead_time import judge_dead_time
from soro_core.control.probing.findings import FAIL, STOP, WARN, ProbeFinding, RelativeGains, judge_answers
from soro_core.control.probing.plan import ProbedArm, end_displacement, plan_probe
from soro_core.control.probing.stamps import StampedPosition, judge_stamps
from soro_core.control.probing.wiring import HeldState, WiringModel
from soro_core.errors import SoroError

Phase: TypeAlias = Literal["rest", "trial", "press", "fall", "done"]
Between: TypeAlias = Callable[[], None]
# The filter needs this time from its start to the arm [s].
_FOUND_S = 0.5
# Longest wait for an arm that still moves [s].
_REST_S = 4.0
# Displacement of an arm at rest within a window, as a part of the length.
_STILL_PART = 0.02
# Part of the pressure behind the play of a valve that a reading has at the end of a hold, deviations of the
# noise that it may lack, and pressure behind the play below which steps of readings hide it [Pa].
_FOLLOWS, _DEVIATIONS, _HIDDEN_PA = 0.5, 3.0, 200.0
# Part of its highest pressure with which the first chamber is tried, and least part that is taken.
_TRIAL, _LEAST_PART = 0.125, 0.35
# Displacement of an arm that falls over in the trial, as a part of the length.
_FALLS_PART = 0.6
# The model stays within the limits of motion under every load; an arm that falls over swings beyond its rest.
_SWING = 1.5
# Strains this far beyond the limits of motion are those of no arm.
_ABSURD = 1e4
# Longest time between two samples [s].
_GAP_S = 0.1


class ProbeSample(NamedTuple):
    """What one tick gives.

    Attributes
    ----------
    t_s : float
        Time [s].
    q, qd : ndarray (n_q,)
        Estimated coordinates and rates.
    pressure_pa : ndarray (n_u,)
        Measured pressures [Pa gauge].
    seen : tuple of StampedPosition
        Positions that have come since the last one.
    """

    t_s: float
    q: Array
    qd: Array
    pressure_pa: Array
    seen: tuple[StampedPosition, ...] = ()


class Row(NamedTuple):
    """A sample, the set points (n_u,) [Pa gauge] that answered it, and the row before."""

    sample: ProbeSample
    setpoint_pa: Array
    before: Row | None

    @property
    def since_s(self) -> float:
        """Time since the row before [s]."""
        return 0.0 if self.before is None else self.sample.t_s - self.before.sample.t_s


@dataclass(frozen=True)
class ProbeState:
    """State of the probe.

    Attributes
    ----------
    phase : Phase
    chamber : int
        The chamber that is pressed.
    started_s : float
        Time at which the phase started [s]; NaN before the first sample.
    setpoint_pa : ndarray (n_u,)
        Set points of now [Pa gauge].
    from_pa : float
        Set point of this chamber when the phase began [Pa gauge].
    part : float
        Part of the highest pressures that is taken.
    row : Row or None
        The latest row.
    held : tuple of HeldState
        Of rest and of each chamber.
    findings : tuple of ProbeFinding
        Complete at the end.
    gains : RelativeGains or None
        Of the chambers, at the end; None where they cannot be told.
    lenient : bool
        Whether what the answers say only warns.
    """

    setpoint_pa: Array
    phase: Phase = "rest"
    chamber: int = -1
    started_s: float = np.nan
    from_pa: float = 0.0
    part: float = 1.0
    row: Row | None = None
    held: tuple[HeldState, ...] = ()
    findings: tuple[ProbeFinding, ...] = ()
    gains: RelativeGains | None = None
    lenient: bool = False

    @property
    def done(self) -> bool:
        """Whether the set points are 0 again and the findings complete."""
        return self.phase == "done"

    @property
    def refusal(self) -> str:
        """Why the law must not begin; empty while nothing speaks against it."""
        levels = (STOP,) if self.lenient else (STOP, FAIL)
        return "; ".join(str(one) for one in self.findings if one.level in levels)

    @property
    def said(self) -> str:
        """All findings."""
        return "; ".join(str(one) for one in self.findings)


class Probe:
    """The probe of one arm.

    Parameters
    ----------
    known : ProbedArm
    lenient : bool
        Whether what the answers say only warns; what ends the probe before its end always refuses.

    Raises
    ------
    ConfigError
        If no pressure is within the limits of motion.
    """

    def __init__(self, known: ProbedArm, lenient: bool = False) -> None:
        self._known, self._lenient = known, lenient
        self.plan = plan_probe(known)
        self._model = WiringModel(known.arm, known.heaviest_kg)

    def warm_up(self) -> None:
        """Judge once without effect: imports and compilation take longer than a tick."""
        n_q, n_u = self._known.arm.n_q, len(self.plan.names)
        held = HeldState(np.full(n_q, 1e-3), np.zeros(n_q), np.zeros(n_q), np.zeros(n_u))
        judge_answers(self._model, self.plan.names, (held, held))
        t = 0.01 * np.arange(50.0)
        command = np.repeat(np.where(t < 0.1, 1.0, 0.0)[:, None], n_u, axis=1)
        judge_dead_time(self.plan.names, t, command, command, self.plan.dead_time_s)
        t = 0.01 * np.arange(200.0)
        swings = np.column_stack([np.sin(3.0 * t)] * 3)
        length_m = self._known.arm.length
        seen = [StampedPosition("", at, length_m * one) for at, one in zip(t.tolist(), swings, strict=True)]
        judge_stamps(t, swings, seen, length_m)

    def initial_state(self) -> ProbeState:
        """Return the state before the first tick."""
        return ProbeState(np.zeros(len(self.plan.names)), lenient=self._lenient)

    def step(
        self, state: ProbeState, sample: ProbeSample, between: Callable[[], None] = lambda: None
    ) -> ProbeState:
        """Return the state after a sample, with the set points that answer it.

        On any doubt the set points are 0 at once, and a finding says why.

        Parameters
        ----------
        state : ProbeState
        sample : ProbeSample
        between : callable
            Called again and again while the answers are judged, with all set points at 0: this takes longer
            than a tick.
        """
        if state.done:
            return state
        if np.isnan(state.started_s):
            state = replace(state, started_s=sample.t_s)
        if failure := self._failure(state, sample):
            return _ended(state, (ProbeFinding(STOP, *failure),))
        state = replace(state, row=Row(sample, state.setpoint_pa, state.row))
        try:
            state = _PHASES[state.phase](self, state, sample, between)
        except (SoroError, np.linalg.LinAlgError) as error:
            found = f"the model has no value {self._at(state)}: {error}"
            return _ended(state, (ProbeFinding(STOP, found, "look at sensors and robot file"),))
        assert state.row is not None
        return replace(state, row=state.row._replace(setpoint_pa=state.setpoint_pa))

    def _failure(self, state: ProbeState, sample: ProbeSample) -> tuple[str, str] | None:
        """Return what ends the probe at once, and the step to take."""
        at = self._at(state)
        if not all(np.isfinite(values).all() for values in sample[:-1]):
            return f"a sample is not finite {at}", "look at the sensors"
        if state.row is not None and not 0.0 < (gap_s := sample.t_s - state.row.sample.t_s) <= _GAP_S:
            return f"no estimate of the arm for {gap_s:.2f} s {at}", "look at sensors and estimator"
        bent = float(np.max(self._known.fields.peaks(sample.q) / self.plan.limit))
        if not bent < _ABSURD:
            return f"no arm has such a state {at}", "look at the sensors"
        # Further than it swings by the model under any load.
        if state.phase == "press" and bent > _SWING:
            return f"the arm is bent beyond the limits of motion {at}", "look at load, robot file and sensors"
        return None

    def _at(self, state: ProbeState) -> str:
        if state.chamber < 0:
            return "before any pressure"
        return f"with {self.plan.names[state.chamber]} at {1e-3 * float(state.setpoint_pa.max()):.1f} kPa"

    def _rest(self, state: ProbeState, sample: ProbeSample, between: Between) -> ProbeState:
        plan, config = self.plan, self._known.bounds
        if sample.t_s - state.started_s < _FOUND_S + plan.window_s:
            return state
        rows = _since(state.row, sample.t_s - plan.window_s)
        held = _held(rows)
        moved = max(end_displacement(self._known.arm, row.sample.q, held.q) for row in rows)
        if moved > _STILL_PART * self._known.arm.length and sample.t_s - state.started_s < _FOUND_S + _REST_S:
            return state
        worst = int(np.argmax(np.abs(held.pressure_pa)))
        if abs(held.pressure_pa[worst]) > config.pressure_pa:
            found = (
                f"the arm is not empty: {plan.names[worst]} is at {1e-3 * held.pressure_pa[worst]:.1f} kPa"
            )
            return _ended(state, (ProbeFinding(STOP, found, "vent it first"),))
        if moved > _STILL_PART * self._known.arm.length:
            found = f"the arm moves: {1e3 * moved:.1f} mm within {plan.window_s:.1f} s without pressure"
            return _ended(state, (ProbeFinding(STOP, found, "wait until it rests, and enable again"),))
        return replace(state, phase="trial", chamber=0, started_s=sample.t_s, held=(held,))

    def _trial(self, state: ProbeState, sample: ProbeSample, between: Between) -> ProbeState:
        """Press the first chamber a little: it shows how much a load leaves of the arm's stiffness."""
        plan, elapsed_s = self.plan, sample.t_s - state.started_s
        if (
            end_displacement(self._known.arm, sample.q, state.held[0].q)
            > _FALLS_PART * self._known.arm.length
        ):
            found = f"the arm falls over under its load {self._at(state)}: its chambers are not probed"
            # At once: the law may still catch it.
            return _ended(state, (ProbeFinding(WARN, found, "take off some of the load, or hang the arm"),))
        state = self._towards(
            state, 0, _TRIAL * float(plan.ceiling_pa[0]) * min(elapsed_s / plan.rise_s, 1.0)
        )
        if elapsed_s < plan.rise_s + plan.settle_s + plan.window_s:
            return state
        # Two pressures of one chamber show how stiffness and load share what is left.
        state = replace(state, held=(*state.held, _held(_since(state.row, sample.t_s - plan.window_s))))
        moved = end_displacement(self._known.arm, sample.q, state.held[0].q)
        part = float(np.clip(_TRIAL * plan.moves_m / max(moved, 1e-9), _LEAST_PART, 1.0))
        return replace(state, phase="press", started_s=sample.t_s, from_pa=state.setpoint_pa[0], part=part)

    def _press(self, state: ProbeState, sample: ProbeSample, between: Between) -> ProbeState:
        plan, k = self.plan, state.chamber
        elapsed_s = sample.t_s - state.started_s
        top = state.part * float(plan.ceiling_pa[k])
        risen = min(elapsed_s / plan.rise_s, 1.0)
        state = self._towards(state, k, state.from_pa + (top - state.from_pa) * risen)
        if elapsed_s < plan.rise_s + plan.settle_s + plan.window_s:
            return state
        rows = _since(state.row, sample.t_s - plan.window_s)
        state = replace(state, held=(*state.held, _held(rows)))
        if silent := self._silent(rows, state.held[0].pressure_pa, k, top):
            return _ended(state, (silent,))
        if k + 1 < len(plan.names):
            return replace(state, chamber=k + 1, started_s=sample.t_s, from_pa=0.0)
        return replace(state, phase="fall", started_s=sample.t_s)

    def _silent(
        self, rows: Sequence[Row], rest_pa: Array, chamber: int, top_pa: float
    ) -> ProbeFinding | None:
        """Return a finding if the reading of a chamber has not risen with its set point."""
        readings = np.array([row.sample.pressure_pa for row in rows])
        risen_pa = readings.mean(axis=0) - rest_pa
        error_pa = _DEVIATIONS * float(readings[:, chamber].std()) * np.sqrt(2.0 / len(rows))
        if self._is_hidden(top_pa) or risen_pa[chamber] >= _FOLLOWS * self._behind_play(top_pa) - error_pa:
            return None
        names, other = self.plan.names, int(np.argmax(risen_pa))
        found = (
            f"{names[chamber]} reads {1e-3 * risen_pa[chamber]:.1f} kPa at a set point of {1e-3 * top_pa:.1f}"
        )
        if other != chamber and risen_pa[other] > _FOLLOWS * self._behind_play(top_pa):
            found += f", and {names[other]} reads {1e-3 * risen_pa[other]:.1f}"
        step = "look at the valve, its line and its sensor: soro hil first-pressure"
        return ProbeFinding(STOP, found, step)

    def _behind_play(self, top_pa: float) -> float:
        """Return the pressure [Pa gauge] to which a set point leads from below."""
        return top_pa - 0.5 * self.plan.play_pa

    def _is_hidden(self, top_pa: float) -> bool:
        return self._behind_play(top_pa) < _HIDDEN_PA

    def _hidden(self, part: float) -> list[ProbeFinding]:
        """Return a finding that names the chambers whose pressures were too small to be read."""
        tops = {n: part * top for n, top in zip(self.plan.names, self.plan.ceiling_pa.tolist(), strict=True)}
        names = [name for name, top_pa in tops.items() if self._is_hidden(top_pa)]
        if not names:
            return []
        most = f"{1e-3 * max(tops[name] for name in names):.1f} kPa"
        found = (
            f"the highest pressure of {', '.join(names)}, {most}, is within the play of its valve: not judged"
        )
        return [ProbeFinding(WARN, found, "take off some of the load, or look with soro hil first-pressure")]

    def _towards(self, state: ProbeState, chamber: int, wanted_pa: float) -> ProbeState:
        """Return the state with one set point on its way to a pressure, and the others on theirs to 0."""
        wanted = np.zeros_like(state.setpoint_pa)
        if chamber >= 0:
            wanted[chamber] = wanted_pa
        step_s = 0.0 if state.row is None else state.row.since_s
        lowest = state.setpoint_pa - self.plan.fall_pa_s * step_s
        highest = state.setpoint_pa + self.plan.rise_pa_s * step_s
        return replace(state, setpoint_pa=np.clip(wanted, lowest, highest))

    def _fall(self, state: ProbeState, sample: ProbeSample, between: Between) -> ProbeState:
        plan = self.plan
        state = self._towards(state, -1, 0.0)
        if sample.t_s - state.started_s < plan.settle_s + plan.window_s:
            return state
        rows = list(_back(state.row))[::-1]
        t = np.array([row.sample.t_s for row in rows])
        command = np.array([row.setpoint_pa for row in rows])
        reading = np.array([row.sample.pressure_pa for row in rows])
        late = judge_dead_time(plan.names, t, command, reading, plan.dead_time_s, between)
        seen = [one for row in rows for one in row.sample.seen]
        late += judge_stamps(t, reading, seen, self._known.arm.length, between)
        found, gains = judge_answers(self._model, plan.names, state.held, between)
        hidden = self._hidden(state.part)
        ended = _ended(state, (*found, *late, *hidden))
        return replace(ended, gains=None if hidden else gains)


_PHASES = {"rest": Probe._rest, "trial": Probe._trial, "press": Probe._press, "fall": Probe._fall}


def _ended(state: ProbeState, findings: tuple[ProbeFinding, ...]) -> ProbeState:
    return replace(state, phase="done", setpoint_pa=np.zeros_like(state.setpoint_pa), findings=findings)


def _back(row: Row | None) -> Iterator[Row]:
    """Yield rows, the latest first."""
    while row is not None:
        yield row
        row = row.before


def _since(row: Row | None, since_s: float) -> list[Row]:
    """Return the rows since a time [s], the oldest first."""
    found = []
    for one in _back(row):
        if one.sample.t_s < since_s:
            break
        found.append(one)
    return found[::-1]


def _held(rows: Sequence[Row]) -> HeldState:
    """Return the means of some rows."""
    samples = [row.sample for row in rows]
    span_s = max(samples[-1].t_s - samples[0].t_s, 1e-9)
    few = max(1, len(samples) // 10)

    def change(values: list[Array]) -> Array:
        return np.asarray(np.mean(values[-few:], axis=0) - np.mean(values[:few], axis=0)) / span_s

    q, qd = [one.q for one in samples], [one.qd for one in samples]
    pressure = np.mean([one.pressure_pa for one in samples], axis=0)
    return HeldState(np.mean(q, axis=0), change(q), change(qd), pressure)
