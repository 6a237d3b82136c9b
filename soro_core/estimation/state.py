"""State of the estimator: the present belief, and the past steps that a late sample may change."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from soro_core.arrays import Array
from soro_core.estimation.force.state import ForceState
from soro_core.estimation.kernel.belief import Belief
from soro_core.estimation.learned_input import LearnedInput
from soro_core.estimation.sensors.monitor import SensorMonitor
from soro_core.estimation.sensors.samples import Sample
from soro_core.estimation.status import Counts

# Never written: `TickState` copies it.
_NONE: Mapping[str, Any] = {}


class Segment(NamedTuple):
    """One past step.

    Attributes
    ----------
    start_s, end_s : float
        Interval [s].
    pressure_pa : ndarray (n_u,)
        Mean pressures [Pa gauge].
    belief : Belief
        Belief at `start_s`.
    samples : tuple of Sample
        Samples fused in the interval.
    known : LearnedInput
        Learned force in the interval.
    """

    start_s: float
    end_s: float
    pressure_pa: Array
    belief: Belief
    samples: tuple[Sample, ...] = ()
    known: LearnedInput = LearnedInput()


class Sensor(NamedTuple):
    """What is kept of one sensor.

    Attributes
    ----------
    sample : Sample
        Its last one.
    record : ndarray (N_RECORD,)
        Its outliers in a row and its last pose, see `kernel.advance`.
    """

    sample: Sample
    record: Array


class EstimatorState(NamedTuple):
    """State of the estimator.

    Attributes
    ----------
    t_s : float
        Time of the last step [s].
    belief : Belief
        Belief at that time.
    pressure_pa : ndarray (n_u,)
        Last good pressures [Pa gauge].
    history : tuple of Segment
        Past steps, oldest first.
    waiting : tuple of Sample
        Samples stamped in the future.
    stamps : mapping of str to float
        Last stamp of each sensor [s].
    last_s : float
        Stamp of the newest fused sample [s].
    position_s : float
        Stamp of the newest fused pose [s].
    sensors : mapping of str to Sensor
        What is kept of each sensor.
    known : LearnedInput
        Learned force in force.
    monitors : mapping of str to SensorMonitor
        How well the samples of each sensor fit.
    counts : Counts
        Counts since the start.
    force : ForceState
        What is known of the external force.
    """

    t_s: float
    belief: Belief
    pressure_pa: Array
    history: tuple[Segment, ...] = ()
    waiting: tuple[Sample, ...] = ()
    stamps: Mapping[str, float] = _NONE
    last_s: float = -math.inf
    position_s: float = -math.inf
    sensors: Mapping[str, Sensor] = _NONE
    known: LearnedInput = LearnedInput()
    monitors: Mapping[str, SensorMonitor] = _NONE
    counts: Counts = Counts()
    force: ForceState = ForceState()
