"""The trade between speed and accuracy: measured cost and error of discretisations, steppers and steps."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_lab.trade.candidate import Candidate as Candidate
    from soro_lab.trade.case import TradeCase as TradeCase
    from soro_lab.trade.case import bare_case as bare_case
    from soro_lab.trade.case import scene_case as scene_case
    from soro_lab.trade.choice import with_chosen_model as with_chosen_model
    from soro_lab.trade.results import CandidateResult as CandidateResult
    from soro_lab.trade.results import Study as Study
    from soro_lab.trade.study import Stopped as Stopped
    from soro_lab.trade.study import run_study as run_study

__all__, __getattr__ = lazy(
    __name__,
    {
        ".candidate": "Candidate",
        ".case": "TradeCase bare_case scene_case",
        ".choice": "with_chosen_model",
        ".results": "CandidateResult Study",
        ".study": "Stopped run_study",
    },
)
