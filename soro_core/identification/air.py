"""Step responses of regulators against every model of them: fitted to all runs, judged on runs not seen.

Each half of the runs is judged by the parameters that the other half gave. A direction that the other half
does not show is not judged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from soro_core.identification.fit import Fit
from soro_core.identification.steps import Step
from soro_core.identification.valves import (
    Array,
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
from soro_core.pneumatics.regulator import RegulatorModel

GOOD = 0.2
"""Largest error of a time to 63.2 % that passes, of the measured one."""

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
class Kind:
    """A way to model regulators: how to fit it and how to simulate it."""

    name: str
    each_line: bool
    """Whether each line has parameters of its own."""
    fit: Callable[[Sequence[Step]], tuple[Any, Fit]]
    response: Callable[[Any, Sequence[Step], Array | None], Response]


@dataclass(frozen=True)
class AirFit:
    """A kind of model fitted.

    Attributes
    ----------
    kind : Kind
    models : dict
        Fitted to all runs, by line; by "" where all lines share one.
    fits : dict
        How well each is determined, by the same names.
    own, held_out : tuple of Judged
        Steps by the model of all runs, and by that of the other half of the runs.
    """

    kind: Kind
    models: dict[str, Any]
    fits: dict[str, Fit]
    own: tuple[Judged, ...]
    held_out: tuple[Judged, ...]

    def model_of(self, line: str) -> Any:
        """Return the model of a line."""
        return self.models[line if self.kind.each_line else ""]

    def response(self, step: Step, t: Array) -> Array:
        """Pressures [Pa gauge] at times t over one step, by the model of all runs."""
        _, pressure = self.kind.response(self.model_of(step.line), [step], t)
        response: Array = pressure[:, 0]
        return response


@dataclass(frozen=True)
class Score:
    """Times to 63.2 % in one direction: steps, those within 20 %, median error, median RMS error [Pa]."""

    n: int
    within: int
    median: float
    rms_pa: float


def kinds(volume_m3: float, supply_pa: float) -> tuple[Kind, ...]:
    """Every kind: lags and flow, one for all lines and one for each."""

    def flow(steps: Sequence[Step]) -> tuple[FlowModel, Fit]:
        return fit_flow(steps, volume_m3, supply_pa)

    def one_lag(steps: Sequence[Step]) -> tuple[RegulatorModel, Fit]:
        return fit_regulator(steps, directional=False)

    return (
        Kind("one lag", False, one_lag, regulator_response),
        Kind("lag for each way", False, fit_regulator, regulator_response),
        Kind("flow", False, flow, flow_response),
        Kind("lag for each way", True, fit_regulator, regulator_response),
        Kind("flow", True, flow, flow_response),
    )


def fit_air(steps: Sequence[Step], kind: Kind) -> AirFit:
    """Fit one kind of model and judge it."""
    one, other = halves(steps)
    t = grid(steps)
    models, fits = {}, {}
    own: list[Judged] = []
    held_out: list[Judged] = []
    for name in sorted({step.line for step in steps}) if kind.each_line else [""]:
        group = [step for step in steps if name in ("", step.line)]
        models[name], fits[name] = kind.fit(group)
        own += judge(group, kind.response(models[name], group, t))
        for seen, unseen in ((one, other), (other, one)):
            known = [step for step in group if step.run in seen]
            shown = {step.fill for step in known}
            asked = [step for step in group if step.run in unseen and step.fill in shown]
            if asked:
                model, _ = kind.fit(known)
                held_out += judge(asked, kind.response(model, asked, t))
    return AirFit(kind, models, fits, tuple(own), tuple(held_out))


def halves(steps: Sequence[Step]) -> tuple[frozenset[str], frozenset[str]]:
    """Names of every other run, and of the others."""
    runs = sorted({step.run for step in steps})
    return frozenset(runs[::2]), frozenset(runs[1::2])


def score(judged: Iterable[Judged], fill: bool) -> Score | None:
    """Summary of one direction; nothing where no step was judged."""
    chosen = [one for one in judged if one.step.fill == fill]
    if not chosen:
        return None
    errors = [one.error for one in chosen]
    rms = float(np.median([one.rms_pa for one in chosen]))
    return Score(len(chosen), sum(e <= GOOD for e in errors), float(np.median(errors)), rms)


def rows(fits: Iterable[AirFit]) -> list[list[str]]:
    """Cells of a table under `HEADER`."""
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
    """Parameters to paste: `emulation` of a platform, or `twin` of a scene, with what they hold for."""
    if isinstance(model, RegulatorModel):
        return {"emulation": {"regulator": _rounded(model.model_dump(exclude_unset=True))}}
    given = {"volume_m3": model.volume_m3, "delay_s": model.delay_s, "vent_delay_s": model.vent_delay_s}
    valve = _rounded(model.valves.model_dump(exclude_unset=True))
    return {"twin": {"air": "states", "valve": valve}, "for": _rounded(given)}


def yaml_text(fitted: AirFit) -> str:
    """Blocks of all models of a fit, as YAML."""
    blocks = {name or "all": block(model) for name, model in fitted.models.items()}
    return str(yaml.safe_dump(blocks if fitted.kind.each_line else blocks["all"], sort_keys=False))


def _rounded(values: dict[str, float]) -> dict[str, float]:
    # The limit is not rounded: it would cut off the set point that it came from.
    return {name: v if name == "maximum_pa" else float(f"{v:.3g}") for name, v in values.items()}
