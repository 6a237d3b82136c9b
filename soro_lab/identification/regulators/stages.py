"""The stages of an identification that concern air: regulators, pumps, leaks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from soro_core.errors import ConfigError
from soro_lab.identification import regulator_fit as air
from soro_lab.identification.fit import Fit
from soro_lab.identification.pump import PumpModel, PumpRun, errors, fit_pump, model_t63, pump_response
from soro_lab.identification.recording import Recording
from soro_lab.identification.regulators.leak import FoundLeak, find_leak
from soro_lab.identification.regulators.sources import leak_runs, pump_runs, step_records
from soro_lab.identification.steps import FoundSteps, PressureRecord, StepLimits, find_steps

ENOUGH = 4
"""Steps by which regulators are fitted in a recording that is made for something else."""

Progress: TypeAlias = Callable[[str, float], None]


@dataclass(frozen=True)
class AirOptions:
    """What recordings do not show, and what is used of them.

    Attributes
    ----------
    volume_m3 : float
        Volume of a chamber with its tube [m^3].
    supply_pa : float
        Gauge pressure of the supply [Pa].
    limits : StepLimits
        Which steps are used.
    """

    volume_m3: float = 30e-6
    supply_pa: float = 200e3
    limits: StepLimits = field(default_factory=StepLimits)


@dataclass(frozen=True)
class FoundRegulators:
    """Models of regulators and valves: `fits` of each kind, and the `steps` that they were fitted to."""

    steps: FoundSteps
    fits: tuple[air.AirFit, ...]

    @property
    def level1(self) -> air.AirFit:
        """The lag of all lines: a platform has one regulator."""
        return self.fits[1]

    @property
    def level2(self) -> air.AirFit:
        """The flow of all lines: a twin has one valve."""
        return self.fits[2]


@dataclass(frozen=True)
class JudgedRun:
    """A run of a pump, judged by the fit to all others.

    Attributes
    ----------
    run : PumpRun
        The run.
    t63_s : float
        Time of the model to 63.2 % of its own way [s].
    rms_pa : float
        RMS error [Pa].
    """

    run: PumpRun
    t63_s: float
    rms_pa: float

    @property
    def error(self) -> float:
        """Relative error of the time to 63.2 %."""
        return float(self.t63_s / self.run.t63_s - 1.0)


@dataclass(frozen=True)
class FoundPump:
    """A pump: `model` and `fit` of all runs, and each run judged by the fit to the others."""

    model: PumpModel
    fit: Fit
    held_out: tuple[JudgedRun, ...]


@dataclass(frozen=True)
class FoundAir:
    """What the stages found; None or empty where recordings do not show it. `volume_m3` was given."""

    volume_m3: float
    regulators: FoundRegulators | None = None
    pump: FoundPump | None = None
    leaks: tuple[FoundLeak, ...] = ()

    def __bool__(self) -> bool:
        return self.regulators is not None or self.pump is not None or bool(self.leaks)

    def shares(self) -> dict[str, float]:
        """Return the held-out RMS error of each stage over the range moved; nan where none was held out."""
        found = {}
        if self.regulators is not None:
            for name, one in (("regulator", self.regulators.level1), ("valve", self.regulators.level2)):
                parts = [j.rms_pa / j.step.change_pa for j in one.held_out]
                found[name] = float(np.median(parts)) if parts else float("nan")
        if self.pump is not None:
            parts = [j.rms_pa / (j.run.levels_pa[1] - j.run.levels_pa[0]) for j in self.pump.held_out]
            found["pump"] = float(np.median(parts)) if parts else float("nan")
        for leak in self.leaks:
            found[f"leak of {leak.run.run} {leak.run.line}"] = leak.error
        return found

    def poor(self, accept: float) -> dict[str, float]:
        """Return the held-out errors above a limit; of regulator and valve the better counts."""
        shares = self.shares()
        both = [shares.pop(name) for name in ("regulator", "valve") if name in shares]
        shares |= {"regulators": min(both)} if both else {}
        return {name: share for name, share in shares.items() if share > accept}

    def unphysical(self) -> list[str]:
        """Return what no hardware does, a line each."""
        return [
            f"{leak.run.run} {leak.run.line}: the leak creates air ({leak.fit.values['rate_1_s']:.3g} 1/s)"
            for leak in self.leaks
            if not leak.is_physical
        ]


def find_air(
    recordings: Sequence[Recording],
    options: AirOptions,
    progress: Progress = lambda stage, cost: None,
    required: bool = False,
) -> FoundAir:
    """Run the stages that the recordings allow.

    Parameters
    ----------
    recordings : sequence of Recording
        Cleaned.
    options : AirOptions
    progress : callable
        Called with the name of a stage and its cost.
    required : bool
        Whether recordings without a usable step are refused; else they have no stage of regulators.

    Raises
    ------
    ConfigError
        If a pump does not fill, a chamber is empty, or `required` and nothing can be fitted.
    """
    records = step_records(recordings)
    regulators = find_regulators(records, options, progress, required) if records else None
    runs = pump_runs(recordings)
    pump = find_pump(runs, options.volume_m3, progress) if runs else None
    leaks = []
    for run in leak_runs(recordings):
        leaks.append(find_leak(run))
        progress(f"leak of {run.run}", leaks[-1].fit.cost)
    found = FoundAir(options.volume_m3, regulators, pump, tuple(leaks))
    if required and not found:
        names = ", ".join(one.name for one in recordings)
        allowed = "set points, a duty cycle, or measured pressures alone; or a robot file first, for a shape"
        raise ConfigError(names, "", "nothing that shows regulators, pumps or leaks", allowed)
    return found


def find_regulators(
    records: Sequence[PressureRecord],
    options: AirOptions,
    progress: Progress = lambda stage, cost: None,
    required: bool = True,
) -> FoundRegulators | None:
    """Fit all kinds of models to the steps of some records.

    Parameters
    ----------
    records : sequence of PressureRecord
        Set points and pressures.
    options : AirOptions
    progress : callable
        Called with the name of a kind and its cost.
    required : bool
        Whether records without a usable step are refused; else None is returned below `ENOUGH`.

    Raises
    ------
    ConfigError
        If there is no step, and one is required.
    """
    steps = FoundSteps((), Counter(), 0, 0, 0)
    for record in records:
        steps += find_steps(record, options.limits)
    if len(steps.steps) < (1 if required else ENOUGH):
        if not required:
            return None
        got = f"no step to fit ({steps})"
        allowed = f"steps that hold {options.limits.hold_s:g} s and more"
        raise ConfigError(", ".join(record.run for record in records), "", got, allowed)
    fits = []
    for kind in air.kinds(options.volume_m3, options.supply_pa):
        fits.append(air.fit_air(steps.steps, kind))
        name = f"{kind.name}, {'each line' if kind.each_line else 'all lines'}"
        progress(name, sum(one.cost for one in fits[-1].fits.values()))
    return FoundRegulators(steps, tuple(fits))


def find_pump(
    runs: Sequence[PumpRun], volume_m3: float, progress: Progress = lambda stage, cost: None
) -> FoundPump:
    """Fit a pump, and judge each run by the fit to all others.

    Parameters
    ----------
    runs : sequence of PumpRun
        Steps from rest.
    volume_m3 : float
        Volume of the chamber with its tube [m^3].
    progress : callable
        Called with the name of a stage and its cost.
    """
    judged = []
    for run in runs if len(runs) > 1 else ():
        model, found = fit_pump([other for other in runs if other is not run], volume_m3)
        left = errors(run, pump_response(model, run))
        judged.append(JudgedRun(run, model_t63(model, run), float(np.sqrt(np.mean(left**2)))))
        progress(f"pump without {run.run}", found.cost)
    model, found = fit_pump(runs, volume_m3)
    return FoundPump(model, found, tuple(judged))


def rounded(value: float) -> Any:
    """Return a number with four digits; None for one that is not finite, which YAML files do not have."""
    return float(f"{value:.4g}") if np.isfinite(value) else None
