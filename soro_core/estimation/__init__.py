"""State estimation: an extended Kalman filter on the arm's model, and the samples that it takes."""

from soro_core.estimation.config import EstimatorConfig
from soro_core.estimation.estimator import Estimator, EstimatorState
from soro_core.estimation.samples import ImuSample, PoseSample, Sample
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
