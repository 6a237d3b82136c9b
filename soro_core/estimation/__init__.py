"""State estimation: an extended Kalman filter on the arm's model, and the samples that it takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.estimation.config import EstimatorConfig
    from soro_core.estimation.estimator import Estimator
    from soro_core.estimation.sensors.samples import ImuSample, PoseSample, Sample
    from soro_core.estimation.state import EstimatorState
    from soro_core.estimation.status import Counts, Estimate, EstimatorStatus

__all__ = [
    "Counts",
    "Estimate",
    "Estimator",
    "EstimatorConfig",
    "EstimatorState",
    "EstimatorStatus",
    "ImuSample",
    "PoseSample",
    "Sample",
]

__getattr__ = lazy(
    __name__,
    {
        "Counts": "soro_core.estimation.status",
        "Estimate": "soro_core.estimation.status",
        "Estimator": "soro_core.estimation.estimator",
        "EstimatorConfig": "soro_core.estimation.config",
        "EstimatorState": "soro_core.estimation.state",
        "EstimatorStatus": "soro_core.estimation.status",
        "ImuSample": "soro_core.estimation.sensors.samples",
        "PoseSample": "soro_core.estimation.sensors.samples",
        "Sample": "soro_core.estimation.sensors.samples",
    },
)
