"""What is learned while the arm moves: one model for law and filter, and a bias of each regulator."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.adaptation.force import LearnedForce as LearnedForce
    from soro_core.adaptation.learned import Learned as Learned
    from soro_core.adaptation.learner import Learner as Learner
    from soro_core.adaptation.learning.state import LearnerSample as LearnerSample
    from soro_core.adaptation.learning.state import LearnerState as LearnerState
    from soro_core.adaptation.regulators import ObserverState as ObserverState
    from soro_core.adaptation.regulators import RegulatorObserver as RegulatorObserver

__all__, __getattr__ = lazy(
    __name__,
    {
        ".force": "LearnedForce",
        ".learned": "Learned",
        ".learner": "Learner",
        ".learning.state": "LearnerSample LearnerState",
        ".regulators": "ObserverState RegulatorObserver",
    },
)
