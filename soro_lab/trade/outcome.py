"""The errors of one candidate, or why it has none: one job of a study."""

from __future__ import annotations

from dataclasses import dataclass

from soro_core.errors import ConfigError, ModelError
from soro_core.model.discretised import discretised
from soro_lab.trade.candidate import Candidate
from soro_lab.trade.case import TradeCase
from soro_lab.trade.trace import Errors, TradeTrace, errors, too_slow, trace


@dataclass(frozen=True)
class Outcome:
    """Errors of a candidate, or why it has none."""

    candidate: Candidate
    errors: Errors | None
    failure: str = ""


def compute(case: TradeCase, truth: TradeTrace, candidate: Candidate) -> Outcome:
    """Compute the errors of one candidate.

    Parameters
    ----------
    case : TradeCase
        Start and pressures.
    truth : TradeTrace
        Reference.
    candidate : Candidate
        Discretisation, stepper and step.
    """
    try:
        arm = discretised(case.robot, candidate.model)
        if slow := too_slow(case, arm, candidate.integrator, candidate.dt_s):
            return Outcome(candidate, None, slow)
        found = trace(case, arm, candidate.integrator, candidate.dt_s)
    except (ConfigError, ModelError) as error:
        return Outcome(candidate, None, str(error))
    return Outcome(candidate, errors(found, truth, case.robot.length))
