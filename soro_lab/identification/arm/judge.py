"""How far a prediction is from what was measured: by run and shape, and in parts of the range moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_lab.identification.arm.cases.case import Case
from soro_lab.identification.recording.streams import Curvature, Marker, Plate, Shape

# Rows beyond this many expected errors count as written off by the soft loss.
_WRITTEN_OFF = 3.0
# A shape that moves less than this part of the one that moves most shows noise: it counts for nothing.
_HARDLY = 0.1
# Samples of one stretch of this time [s] have one error in common, and count as one.
_BLOCK_S = 2.0


@dataclass(frozen=True)
class Error:
    """Error of one shape in one case.

    Attributes
    ----------
    case, shape : str
    unit : str
        m, 1/m or rad.
    rms, worst : float
        Of the length of the difference: of the position of a plate.
    turn_rms : float
        Of the angle of a plate [rad]; nan of others.
    samples : int
    written_off : float
        Part of the samples beyond three expected errors.
    """

    case: str
    shape: str
    unit: str
    rms: float
    worst: float
    turn_rms: float
    samples: int
    written_off: float

    def __str__(self) -> str:
        turn = "" if np.isnan(self.turn_rms) else f", angle {np.degrees(self.turn_rms):.2g} deg"
        off = f"; {100 * self.written_off:.0f} % beyond three expected errors" if self.written_off else ""
        size, worst = _size(self.rms, self.unit), _size(self.worst, self.unit)
        return f"{self.case}, {self.shape}: RMS {size}{turn}, worst {worst}{off}"


def errors(
    cases: Sequence[Case], differences: Sequence[Sequence[Array]], expected: Mapping[str, Array]
) -> tuple[Error, ...]:
    """Return the error of each shape of each case that has samples.

    Parameters
    ----------
    cases : sequence of Case
    differences : sequence of sequences of array
        Of each shape of each case, as `difference` gives them.
    expected : mapping of str to array
        Expected error of each column, by the name of the shape.
    """
    found = []
    for case, own in zip(cases, differences, strict=True):
        for shape, rows in zip(case.shapes, own, strict=True):
            if not len(rows):
                continue
            size = np.linalg.norm(rows[:, : _places(shape)], axis=1)
            turn = np.linalg.norm(rows[:, 3:], axis=1) if isinstance(shape, Plate) else np.array([np.nan])
            off = float(np.mean(np.abs(rows / expected[shape.name]).max(axis=1) > _WRITTEN_OFF))
            worst, rms = float(size.max()), _rms(size)
            found.append(Error(case.name, shape.name, unit_of(shape), rms, worst, _rms(turn), len(rows), off))
    return tuple(found)


def squares(
    cases: Sequence[Case],
    differences: Sequence[Sequence[Array]],
    moved: Mapping[str, float],
) -> tuple[float, ...]:
    """Return the mean square error of each stretch of `_BLOCK_S`, in ranges moved, of what moves.

    Parameters
    ----------
    cases : sequence of Case
    differences : sequence of sequences of array
        Of each shape of each case, as `difference` gives them.
    moved : mapping of str to float
        `ranges` of all cases.
    """
    found = []
    largest: dict[str, float] = {}
    for shape in (shape for case in cases for shape in case.shapes):
        largest[unit_of(shape)] = max(largest.get(unit_of(shape), 0.0), moved[shape.name])
    for case, own in zip(cases, differences, strict=True):
        parts: dict[int, list[float]] = {}
        for shape, rows in zip(case.shapes, own, strict=True):
            if not moved[shape.name] > _HARDLY * largest[unit_of(shape)]:
                continue
            size = np.sum(rows[:, : _places(shape)] ** 2, axis=1) / moved[shape.name] ** 2
            for block in np.unique(np.floor(shape.t / _BLOCK_S)):
                inside = size[np.floor(shape.t / _BLOCK_S) == block]
                parts.setdefault(int(block), []).append(float(inside.mean()))
        found += [float(np.mean(parts[block])) for block in sorted(parts)]
    return tuple(found)


def ranges(cases: Sequence[Case]) -> dict[str, float]:
    """Return how far each shape moved in all cases: the diagonal of the box around its values, by name."""
    values: dict[str, list[Array]] = {}
    for case in cases:
        for shape in case.shapes:
            values.setdefault(shape.name, []).append(shape.motion())
    return {
        name: float(np.linalg.norm(np.ptp(np.concatenate(rows), axis=0))) for name, rows in values.items()
    }


def share_of_range(found: Sequence[Error], moved: Mapping[str, float]) -> float:
    """Return the RMS over all samples of error over range, without shapes that hardly moved.

    Parameters
    ----------
    found : sequence of Error
    moved : mapping of str to float
        `ranges` of the cases.
    """
    largest: dict[str, float] = {}
    for e in found:
        largest[e.unit] = max(largest.get(e.unit, 0.0), moved[e.shape])
    used = [e for e in found if moved[e.shape] > _HARDLY * largest[e.unit]]
    squares = sum(e.samples * (e.rms / moved[e.shape]) ** 2 for e in used)
    return float(np.sqrt(squares / max(1, sum(e.samples for e in used))))


def unit_of(shape: Shape) -> str:
    """Return the unit of the error of a shape."""
    if isinstance(shape, Plate | Marker):
        return "m"
    return "1/m" if isinstance(shape, Curvature) else "rad"


def _size(value: float, unit: str) -> str:
    return f"{1e3 * value:.3g} mm" if unit == "m" else f"{value:.3g} {unit}"


def _places(shape: Shape) -> int:
    return 3 if isinstance(shape, Plate) else shape.motion().reshape(len(shape.t), -1).shape[1]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
