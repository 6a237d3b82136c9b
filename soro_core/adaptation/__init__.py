"""What is learned while the arm moves: one model for law and filter, and a bias of each regulator."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.adaptation.force import LearnedForce
    from soro_core.adaptation.learned import Learned
    from soro_core.adaptation.learner import Learner, LearnerSample, LearnerState
    from soro_core.adaptation.regulators import ObserverState, RegulatorObserver

__all__ = [
    "Learned",
    "LearnedForce",
    "Learner",
    "LearnerSample",
    "LearnerState",
    "ObserverState",
    "RegulatorObserver",
]

__getattr__ = lazy(
    __name__,
    {
        "Learned": "soro_core.adaptation.learned",
        "LearnedForce": "soro_core.adaptation.force",
        "Learner": "soro_core.adaptation.learner",
        "LearnerState": "soro_core.adaptation.learner",
        "RegulatorObserver": "soro_core.adaptation.regulators",
        "ObserverState": "soro_core.adaptation.regulators",
        "LearnerSample": "soro_core.adaptation.learner",
    },
)
