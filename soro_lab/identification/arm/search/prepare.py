"""What a fit begins with: cases from recordings, states at rest, and how large errors may be expected."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_lab.identification.arm.cases.case import Interval, Rests, Whole
from soro_lab.identification.arm.search.problem import Problem
from soro_lab.identification.recording import (
    Plate,
    Recording,
    hold_out,
    rest_states,
    sections,
    still_limits,
)
from soro_lab.identification.recording.streams import Attitude, Curvature, Marker, Shape

# Of recordings with one section each the second is held out, and each that many further.
_EVERY = 4
# Expected errors before any fit, in parts of the range that a shape moved, and of a plate's angle [rad].
_FIRST_SHARE, _FIRST_TURN = 0.03, 0.05
# No expected error is smaller than this: m, rad, 1/m.
_LEAST = {"m": 1e-4, "rad": 1e-3, "1/m": 1e-3}


def split(
    recordings: Sequence[Recording], dt_s: float, rate_hz: float, named: Collection[str] = ()
) -> tuple[list[Whole], list[Whole]]:
    """Return cases of the fit and of the judge: sections of each kind are held out of every recording.

    Where no recording has two sections of a kind, whole recordings are held out: the second, and every
    fourth on, if the first one shows what they show. Names of recordings replace both rules.

    Parameters
    ----------
    recordings : sequence of Recording
    dt_s : float
        Step of their simulations [s].
    rate_hz : float
        Samples a second that are compared.
    named : collection of str

    Raises
    ------
    ConfigError
        If no section has pressures and shape, a name is not one of a recording, or a named recording has a
        stream that no other has.
    """
    fit: list[Whole] = []
    held: list[Whole] = []
    still = still_limits(recordings)
    cut = [sections(recording, still=still) for recording in recordings]
    parted = [hold_out(own) for own in cut]
    if named:
        names = [recording.name for recording in recordings]
        odd = [name for name in named if name not in names]
        if odd:
            raise ConfigError("recordings", "hold_out", odd[0], ", ".join(names))
        parted = [((), own) if name in named else (own, ()) for name, own in zip(names, cut, strict=True)]
    elif not any(out for _, out in parted):
        known = [k for k, (used, _) in enumerate(parted) if used]
        streams = [{shape.name for shape in recording.shapes} for recording in recordings]
        whole = {k for k in known[1::_EVERY] if streams[k] <= streams[known[0]]}
        parted = [((), used) if k in whole else (used, out) for k, (used, out) in enumerate(parted)]
    for recording, (used, out) in zip(recordings, parted, strict=True):
        for parts, into in ((used, fit), (out, held)):
            if parts:
                judged: tuple[Interval, ...] = tuple((p.start, p.end) for p in parts)
                into.append(Whole(recording, dt_s, judged, rate_hz))
    if not fit:
        raise ConfigError("recordings", "", "no section with pressures and shape", "a recording with both")
    _check_seen(fit, held)
    return fit, held


def _check_seen(fit: Sequence[Whole], held: Sequence[Whole]) -> None:
    """Refuse a judge with a stream that no fit sees: its frame would not be known."""
    known = {shape.name for case in fit for shape in case.shapes}
    for case in held:
        for shape in case.shapes:
            if shape.name not in known:
                raise ConfigError(case.name, "hold_out", shape.name, f"a run that shows {', '.join(known)}")


def rests_of(recordings: Sequence[Recording]) -> Rests | None:
    """All states at rest of all recordings; None where there are fewer than three."""
    pressure: list[Array] = []
    loads: list[float] = []
    pushes: list[tuple[float, float, float]] = []
    rows: dict[str, list[tuple[int, Array, Shape]]] = {}
    still = still_limits(recordings)
    for recording in recordings:
        by_name = {shape.name: shape for shape in recording.shapes}
        for state in rest_states(recording, still):
            for mean in state.shapes:
                rows.setdefault(mean.stream, []).append((len(pressure), mean.value, by_name[mean.stream]))
            pressure.append(state.pressure.value)
            loads.append(recording.load_kg)
            pushes.append(recording.push_n)
    if len(pressure) < 3 or not any(isinstance(r[0][2], Plate | Marker | Attitude) for r in rows.values()):
        return None
    shapes = tuple(
        _of_means(r[0][2], np.array([k for k, _, _ in r], float), np.array([v for _, v, _ in r]))
        for r in rows.values()
    )
    return Rests("states at rest", np.array(pressure), shapes, tuple(loads), tuple(pushes))


def _of_means(shape: Shape, t: Array, values: Array) -> Shape:
    if isinstance(shape, Plate):
        return replace(shape, t=t, position=values[:, :3], quaternion=values[:, 3:])
    if isinstance(shape, Marker):
        return replace(shape, t=t, position=values)
    if isinstance(shape, Attitude):
        return replace(shape, t=t, quaternion=values)
    return (
        replace(shape, t=t, curvature=values)
        if isinstance(shape, Curvature)
        else replace(shape, t=t, angle=values[:, 0])
    )


def first_errors(shape: Shape, moved: float) -> Array:
    """Expected error of each column before any fit."""
    if isinstance(shape, Plate):
        return np.array([max(_FIRST_SHARE * moved, _LEAST["m"])] * 3 + [_FIRST_TURN] * 3)
    if isinstance(shape, Attitude):
        return np.full(3, _FIRST_TURN)
    width = shape.motion().reshape(len(shape.t), -1).shape[1] if len(shape.t) else 1
    least = _LEAST["m" if isinstance(shape, Marker) else "1/m" if isinstance(shape, Curvature) else "rad"]
    return np.full(width, max(_FIRST_SHARE * moved, least))


def residual_errors(problem: Problem, values: Mapping[str, float]) -> dict[str, Array]:
    """Expected errors after a fit: the RMS of what is left of each shape, of places and angles apart."""
    found: dict[str, list[Array]] = {}
    for case, own in zip(problem.cases, problem.prediction_errors(values), strict=True):
        for shape, rows in zip(case.shapes, own, strict=True):
            found.setdefault(shape.name, []).append(rows)
    expected = {}
    for name, parts in found.items():
        squares = np.mean(np.concatenate(parts) ** 2, axis=0)
        groups = [squares[:3], squares[3:]] if len(squares) == 6 else [squares]
        least = [_LEAST["m"], _LEAST["rad"]]
        expected[name] = np.concatenate(
            [
                np.full(len(g), max(float(np.sqrt(g.mean())), low))
                for g, low in zip(groups, least, strict=False)
            ]
        )
    return expected
