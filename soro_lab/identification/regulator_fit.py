"""Comparison of regulator models with recorded step responses: fitted to all runs, judged on held-out runs.

Cross-validation: some runs in turn are judged by the parameters fitted to all others; of a single run,
some of its steps. A direction (fill or vent) that is missing in the others is not judged.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from soro_core.arrays import Array
from soro_core.pneumatics.regulator import RegulatorModel
from soro_lab.identification.fit import Fit
from soro_lab.identification.steps import Step
from soro_lab.identification.valves import (
    FlowModel,
    Judged,
    Response,
    fit_flow,
    fit_regulator,
    flow_response,
    grid,
    judge,
    regulator_response,
)

GOOD = 0.2
"""Largest relative error of a time to 63.2 % that passes."""

MOST_GROUPS = 8
"""Largest number of groups; runs with neighbouring names, mostly of one day, are in one group."""

HEADER = (
    "model",
    "parameters for",
    "judged on",
    "fill: median error of t63",
    "within 20 %",
    "RMS, kPa",
    "vent: median error of t63",
    "within 20 %",
    "RMS, kPa",
)


@dataclass(frozen=True)
class RegulatorModelType:
    """A kind of regulator model.

    Attributes
    ----------
    name : str
        Name in tables.
    each_line : bool
        Whether each line has parameters of its own.
    fit : callable
        Function that fits the model to steps.
    response : callable
        Function that simulates the model over steps.
    """

    name: str
    each_line: bool
    fit: Callable[[Sequence[Step]], tuple[Any, Fit]]
    response: Callable[[Any, Sequence[Step], Array | None], Response]


@dataclass(frozen=True)
class AirFit:
    """A fitted kind of model.

    Attributes
    ----------
    kind : RegulatorModelType
        Kind of model.
    models : dict
        Models fitted to all runs by line; the key is "" if all lines share one.
    fits : dict
        Outcome of each fit, by the same keys.
    own, held_out : tuple of Judged
        Steps judged by the model of all runs, and by a model that has not seen their run.
    """

    kind: RegulatorModelType
    models: dict[str, Any]
    fits: dict[str, Fit]
    own: tuple[Judged, ...]
    held_out: tuple[Judged, ...]

    def response(self, step: Step, t: Array) -> Array:
        """Return the pressures [Pa gauge] of the model of all runs at times t [s] over one step."""
        model = self.models[step.line if self.kind.each_line else ""]
        _, pressure = self.kind.response(model, [step], t)
        response: Array = pressure[:, 0]
        return response


@dataclass(frozen=True)
class Score:
    """Summary of one direction.

    Attributes
    ----------
    n, within : int
        Judged steps, and those whose time to 63.2 % is within `GOOD`.
    median : float
        Median relative error of the time to 63.2 %.
    rms_pa : float
        Median of the RMS errors of the steps [Pa].
    """

    n: int
    within: int
    median: float
    rms_pa: float


def kinds(volume_m3: float, supply_pa: float) -> tuple[RegulatorModelType, ...]:
    """Return all kinds: lags and flow, for all lines or for each line; the last one is the best.

    Parameters
    ----------
    volume_m3 : float
        Volume of a chamber with its tube [m^3].
    supply_pa : float
        Gauge pressure of the supply [Pa].
    """

    def flow(steps: Sequence[Step]) -> tuple[FlowModel, Fit]:
        return fit_flow(steps, volume_m3, supply_pa)

    def one_band(steps: Sequence[Step]) -> tuple[FlowModel, Fit]:
        return fit_flow(steps, volume_m3, supply_pa, directional=False)

    def one_lag(steps: Sequence[Step]) -> tuple[RegulatorModel, Fit]:
        return fit_regulator(steps, directional=False)

    return (
        RegulatorModelType("one lag", False, one_lag, regulator_response),
        RegulatorModelType("lag for each way", False, fit_regulator, regulator_response),
        RegulatorModelType("flow", False, flow, flow_response),
        RegulatorModelType("lag for each way", True, fit_regulator, regulator_response),
        RegulatorModelType("flow, one band", True, one_band, flow_response),
        RegulatorModelType("flow", True, flow, flow_response),
    )


def fit_air(
    steps: Sequence[Step], kind: RegulatorModelType, group_of: Callable[[Step], str | int] | None = None
) -> AirFit:
    """Fit one kind of model and judge it on own and held-out steps.

    Parameters
    ----------
    steps : sequence of Step
        Measured steps.
    kind : RegulatorModelType
    group_of : callable, optional
        Group of a step: each group in turn is held out. Default: `groups`.
    """
    members = groups(steps) if group_of is None else {id(step): group_of(step) for step in steps}
    t = grid(steps)
    models, fits = {}, {}
    own: list[Judged] = []
    held_out: list[Judged] = []
    for name in sorted({step.line for step in steps}) if kind.each_line else [""]:
        group = [step for step in steps if name in ("", step.line)]
        models[name], fits[name] = kind.fit(group)
        own += judge(group, kind.response(models[name], group, t))
        for out in sorted({members[id(step)] for step in group}):
            training = [step for step in group if members[id(step)] != out]
            directions = {step.fill for step in training}
            test = [step for step in group if members[id(step)] == out and step.fill in directions]
            if test:
                model, _ = kind.fit(training)
                held_out += judge(test, kind.response(model, test, t))
    return AirFit(kind, models, fits, tuple(own), tuple(held_out))


def groups(steps: Sequence[Step]) -> dict[int, int]:
    """Return the group of each step by its id: groups of runs, or, in a single run, of its steps."""
    runs = sorted({step.run for step in steps})
    if len(runs) > 1:
        number = min(MOST_GROUPS, len(runs))
        return {id(step): runs.index(step.run) * number // len(runs) for step in steps}
    seen: Counter[tuple[str, bool]] = Counter()
    found = {}
    for step in steps:
        found[id(step)] = seen[step.line, step.fill] % 2
        seen[step.line, step.fill] += 1
    return found


def score(judged: Iterable[Judged], fill: bool) -> Score | None:
    """Return the summary of one direction, or None without judged steps."""
    chosen = [one for one in judged if one.step.fill == fill]
    if not chosen:
        return None
    errors = [one.error for one in chosen]
    rms = float(np.median([one.rms_pa for one in chosen]))
    return Score(len(chosen), sum(e <= GOOD for e in errors), float(np.median(errors)), rms)


def rows(fits: Iterable[AirFit]) -> list[list[str]]:
    """Return the rows of a table with the head `HEADER`."""
    table = []
    for fitted in fits:
        for on, judged in (("all runs, its own", fitted.own), ("runs not seen", fitted.held_out)):
            cells = [fitted.kind.name, "each line" if fitted.kind.each_line else "all lines", on]
            for fill in (True, False):
                result = score(judged, fill)
                cells += ["-"] * 3 if result is None else _cells(result)
            table.append(cells)
    return table


def _cells(result: Score) -> list[str]:
    return [
        f"{100 * result.median:.0f} %",
        f"{result.within} of {result.n}",
        f"{result.rms_pa / 1e3:.1f}",
    ]


def block(model: RegulatorModel | FlowModel) -> dict[str, Any]:
    """Return parameters to paste: section `regulator` of a platform, or `twin` of a scene."""
    if isinstance(model, RegulatorModel):
        return {"regulator": _rounded(model.model_dump(exclude_unset=True))}
    given = {"volume_m3": model.volume_m3, "delay_s": model.delay_s, "vent_delay_s": model.vent_delay_s}
    valve = _rounded(model.valves.model_dump(exclude_unset=True))
    return {"twin": {"air": "states", "valve": valve}, "for": _rounded(given)}


def yaml_text(fitted: AirFit) -> str:
    """Return the blocks of all models of a fit as YAML."""
    blocks = {name or "all": block(model) for name, model in fitted.models.items()}
    return str(yaml.safe_dump(blocks if fitted.kind.each_line else blocks["all"], sort_keys=False))


def _rounded(values: dict[str, float]) -> dict[str, float]:
    # The limit is not rounded: a rounded one could clip the set point that it comes from.
    return {name: v if name == "maximum_pa" else float(f"{v:.3g}") for name, v in values.items()}
