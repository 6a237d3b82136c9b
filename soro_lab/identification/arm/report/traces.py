"""Measured and predicted shape of each run over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch

import numpy as np
from scipy.spatial.transform import Rotation

from soro_core.arrays import Array, Flags
from soro_lab.identification.arm.cases.case import Interval, Whole
from soro_lab.identification.arm.stages import ArmIdentification
from soro_lab.identification.recording import Recording
from soro_lab.identification.recording.streams import Attitude, Bend, Curvature, Marker, Plate, Shape


@dataclass(frozen=True)
class TracePanel:
    """Columns of one kind.

    Attributes
    ----------
    title, unit : str
    labels : tuple of str
    measured, predicted : (n, m)
        In `unit`.
    """

    title: str
    unit: str
    labels: tuple[str, ...]
    measured: Array
    predicted: Array


@dataclass(frozen=True)
class ShapeTrace:
    """One shape of one run.

    Attributes
    ----------
    run, shape : str
    recording : Recording
    stream : Shape
        Samples that are compared.
    differences : (n, k)
        Measured minus predicted, in SI.
    expected : (k,)
        Expected errors of the last fit, in SI.
    weights : (n,)
        Weight of each sample in the last fit: 1 of one that counts in full, less of one far off.
    held_out : (n,) of bool
        Samples that the prediction has not seen.
    shaded : tuple of (start, end)
        Sections held out [s].
    panels : tuple of TracePanel
    """

    run: str
    shape: str
    recording: Recording
    stream: Shape
    differences: Array
    expected: Array
    weights: Array
    held_out: Flags
    shaded: tuple[Interval, ...]
    panels: tuple[TracePanel, ...]


def prediction_of(found: ArmIdentification) -> dict[str, float]:
    """Return the numbers that predict: of the fit without the held-out sections, where there is one."""
    own = {n.name for n in found.problem.numbers}
    judged = found.choice.chosen.values if found.choice is not None else {}
    return {**found.solution.values, **{k: v for k, v in judged.items() if k in own}}


def traces(found: ArmIdentification) -> tuple[ShapeTrace, ...]:
    """Return what is measured and predicted of each shape of each run."""
    problem = found.problem
    differences = problem.prediction_errors(prediction_of(found))
    weights = _weights(found)
    result = []
    for case, own, sure in zip(problem.cases, differences, weights, strict=True):
        assert isinstance(case, Whole)
        held = tuple(
            part for other in found.held_cases if other.recording is case.recording for part in other.judged
        )
        for shape, rows, weight in zip(case.shapes, own, sure, strict=True):
            if not len(shape.t):
                continue
            inside = np.zeros(len(shape.t), bool)
            for start, end in held:
                inside |= (shape.t >= start) & (shape.t <= end)
            result.append(
                ShapeTrace(
                    case.name,
                    shape.name,
                    case.recording,
                    shape,
                    rows,
                    problem.expected[shape.name],
                    weight,
                    inside,
                    held,
                    panels(shape, rows),
                )
            )
    return tuple(result)


def _weights(found: ArmIdentification) -> Sequence[Sequence[Array]]:
    """Mean weight of the rows of each sample, of each shape of each case, in the order of the rows."""
    each = 1.0 / np.sqrt(1.0 + found.solution.rows**2)
    at, result = 0, []
    for case in found.problem.cases:
        own = []
        for shape in case.shapes:
            width = len(found.problem.expected[shape.name])
            size = width * len(shape.t)
            own.append(each[at : at + size].reshape(-1, width).mean(axis=1))
            at += size
        result.append(own)
    return result


@singledispatch
def panels(shape: Shape, differences: Array) -> tuple[TracePanel, ...]:
    """Return measured and predicted columns in the units of a reader.

    Parameters
    ----------
    shape : Plate, Marker, Curvature, Bend or Attitude
        Measured (n samples).
    differences : (n, k)
        Measured minus predicted, in SI.
    """
    raise TypeError(f"{type(shape).__name__}: allowed are the streams of `Shape`")


@panels.register
def _(shape: Plate, differences: Array) -> tuple[TracePanel, ...]:
    return _places(shape.position, differences[:, :3]), _turns(shape.quaternion, differences[:, 3:])


@panels.register
def _(shape: Attitude, differences: Array) -> tuple[TracePanel, ...]:
    return (_turns(shape.quaternion, differences),)


@panels.register
def _(shape: Marker, differences: Array) -> tuple[TracePanel, ...]:
    return (_places(shape.position, differences),)


@panels.register
def _(shape: Curvature, differences: Array) -> tuple[TracePanel, ...]:
    return (TracePanel("curvature", "1/m", ("x", "y"), shape.curvature, shape.curvature - differences),)


@panels.register
def _(shape: Bend, differences: Array) -> tuple[TracePanel, ...]:
    measured = np.degrees(shape.angle)[:, None]
    return (TracePanel("bending angle", "deg", ("angle",), measured, measured - np.degrees(differences)),)


def _turns(quaternion: Array, differences: Array) -> TracePanel:
    shown = Rotation.from_quat(quaternion)
    predicted = shown * Rotation.from_rotvec(differences).inv()
    first = shown[0].inv()
    turned = [np.degrees(np.unwrap((first * r).as_rotvec(), axis=0)) for r in (shown, predicted)]
    return TracePanel("rotation since the start", "deg", ("x", "y", "z"), turned[0], turned[1])


def _places(position: Array, differences: Array) -> TracePanel:
    return TracePanel("position", "mm", ("x", "y", "z"), 1e3 * position, 1e3 * (position - differences))
