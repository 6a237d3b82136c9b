"""The trade between speed and accuracy: measured cost and error of discretisations, steppers and steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soro_core._lazy import lazy

if TYPE_CHECKING:
    from soro_core.trade.candidate import Candidate
    from soro_core.trade.case import Case, bare_case, scene_case
    from soro_core.trade.choice import with_chosen_model
    from soro_core.trade.results import Row, Study
    from soro_core.trade.study import Stopped, run_study

__all__ = [
    "Candidate",
    "Case",
    "Row",
    "Stopped",
    "Study",
    "bare_case",
    "run_study",
    "scene_case",
    "with_chosen_model",
]

__getattr__ = lazy(
    __name__,
    {
        "Candidate": "soro_core.trade.candidate",
        "Case": "soro_core.trade.case",
        "Row": "soro_core.trade.results",
        "Stopped": "soro_core.trade.study",
        "Study": "soro_core.trade.results",
        "bare_case": "soro_core.trade.case",
        "run_study": "soro_core.trade.study",
        "scene_case": "soro_core.trade.case",
        "with_chosen_model": "soro_core.trade.choice",
    },
)
