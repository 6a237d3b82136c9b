"""State estimation: an extended Kalman filter on the arm's model, and the samples that it takes."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.estimation.config import EstimatorConfig as EstimatorConfig
    from soro_core.estimation.estimator import Estimator as Estimator
    from soro_core.estimation.sensors.samples import ImuSample as ImuSample
    from soro_core.estimation.sensors.samples import PoseSample as PoseSample
    from soro_core.estimation.sensors.samples import Sample as Sample
    from soro_core.estimation.state import EstimatorState as EstimatorState
    from soro_core.estimation.status import Counts as Counts
    from soro_core.estimation.status import Estimate as Estimate
    from soro_core.estimation.status import EstimatorStatus as EstimatorStatus

__all__, __getattr__ = lazy(
    __name__,
    {
        ".config": "EstimatorConfig",
        ".estimator": "Estimator",
        ".sensors.samples": "ImuSample PoseSample Sample",
        ".state": "EstimatorState",
        ".status": "Counts Estimate EstimatorStatus",
    },
)
