"""The trade between speed and accuracy: measured cost and error of discretisations, steppers and steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_lab.trade.candidate import Candidate
    from soro_lab.trade.case import TradeCase, bare_case, scene_case
    from soro_lab.trade.choice import with_chosen_model
    from soro_lab.trade.results import CandidateResult, Study
    from soro_lab.trade.study import Stopped, run_study

__all__ = [
    "Candidate",
    "CandidateResult",
    "Stopped",
    "Study",
    "TradeCase",
    "bare_case",
    "run_study",
    "scene_case",
    "with_chosen_model",
]

__getattr__ = lazy(
    __name__,
    {
        "Candidate": "soro_lab.trade.candidate",
        "TradeCase": "soro_lab.trade.case",
        "CandidateResult": "soro_lab.trade.results",
        "Stopped": "soro_lab.trade.study",
        "Study": "soro_lab.trade.results",
        "bare_case": "soro_lab.trade.case",
        "run_study": "soro_lab.trade.study",
        "scene_case": "soro_lab.trade.case",
        "with_chosen_model": "soro_lab.trade.choice",
    },
)
