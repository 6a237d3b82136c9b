"""Recorded step responses of real regulators and a real pump, fitted by the regulator and flow models."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks import air_picture
from benchmarks.air_picture import Pumped
from benchmarks.options import Options
from benchmarks.report import figure, table
from soro_core.identification import air
from soro_core.identification.pump import (
    FULL,
    InnerPI,
    PumpModel,
    PumpRun,
    errors,
    fit_pump,
    part_of,
    pump_response,
    read_pump_run,
)
from soro_core.identification.steps import FoundSteps, crossing, find_steps, read_pressures

TITLE = "Measured step responses"
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
# Neither is published. Only the ratio of conductance to volume shows in a step, and of the supply nothing.
VOLUME_M3 = 30e-6
SUPPLY_PA = 200e3
# Gains of the runs: in the name the one that is varied; the other, and full power beyond 5 kPa, stand in the
# authors' summaries and firmware (softbot_pneumatic_driver) and show in the recorded duty cycles.
GAINS = {
    "sweep_kp_10": (10.0, 300.0),
    "sweep_kp_20": (20.0, 300.0),
    "sweep_kp_30": (30.0, 300.0),
    "sweep_ki_300": (15.0, 300.0),
    "sweep_ki_500": (15.0, 500.0),
    "sweep_ki_700": (15.0, 700.0),
}
FULL_ABOVE_PA = 5e3


def run(options: Options) -> str:
    """Fit both data sets; a picture, tables, and parameters to paste."""
    data = Path(os.environ.get("SORO_DATA", DATA))
    if not (data / "asu_two_segment").is_dir():
        return f"Not measured: no data set in {data} (SORO_DATA names another folder)."
    found = regulators(data, options.pick("*", "2023_jan_23*"))
    fits = []
    for kind in options.pick(air.kinds(VOLUME_M3, SUPPLY_PA), air.kinds(VOLUME_M3, SUPPLY_PA)[1:3]):
        options.say(f"{kind.name}, {'each line' if kind.each_line else 'all lines'}")
        fits.append(air.fit_air(found.steps, kind))
    pumped = pumps(data, options)
    options.say("picture")
    air_picture.air_fit(options.folder / "air_fit.png", found, fits, pumped)
    return "\n\n".join(
        [
            f"asu_two_segment: six lines on SMC ITV regulators. {found}.",
            table(air.HEADER, air.rows(fits)),
            scatter(found),
            offsets(found),
            "One regulator for all lines, to paste into a platform:",
            f"```yaml\n{air.yaml_text(fits[1 if len(fits) > 2 else 0])}```",
            valves(fits[-1]),
            pump_text(pumped),
            "![measured points and models](air_fit.png)",
        ]
    )


def regulators(data: Path, runs: str = "*") -> FoundSteps:
    """Steps of the runs of the ASU robot with such names."""
    found = FoundSteps((), Counter(), 0, 0, 0)
    for path in sorted((data / "asu_two_segment").glob(f"{runs}.csv")):
        found += find_steps(read_pressures(path))
    return found


def valves(fitted: air.AirFit) -> str:
    """Parameters of the flow."""
    rows = []
    for line, model in fitted.models.items():
        conductances = (model.valves.fill_m3_s_pa, model.valves.vent_m3_s_pa)
        rows.append(
            [
                line or "all",
                *(figure(1e8 * c) for c in conductances),
                figure(model.valves.band_pa / 1e3),
                figure(model.delay_s),
                figure(model.vent_delay_s),
            ]
        )
    header = (
        "flow, line",
        "C fill, l/(s bar)",
        "C vent, l/(s bar)",
        "band, kPa",
        "delay, s",
        "vent delay, s",
    )
    given = f"{1e6 * VOLUME_M3:g} ml and a supply of {SUPPLY_PA / 1e3:g} kPa"
    return (
        f"{table(header, rows)}\n\nFor a volume of {given}, which are not published: only C over volume "
        "counts, and steps tell next to nothing of the supply."
    )


def scatter(found: FoundSteps) -> str:
    """How far equal steps of one line differ among themselves, which no model of a step can foresee."""
    parts = []
    for fill, way in ((True, "fills"), (False, "vents")):
        alike: dict[tuple[str, int], list[float]] = {}
        for step in found.steps:
            if step.fill == fill:
                alike.setdefault((step.line, round(step.change_pa / 2e4)), []).append(step.t63_s)
        off = [abs(float(np.median(times)) / t - 1.0) for times in alike.values() for t in times]
        parts.append(f"{sum(e <= air.GOOD for e in off)} of {len(off)} {way}")
    return (
        f"Measured steps within 20 % of the median of their equals (same line and size): {', '.join(parts)}."
    )


def offsets(found: FoundSteps) -> str:
    """Readings at rest less set points: offsets of the sensors, which the fits leave out."""
    rows = []
    for line in sorted({step.line for step in found.steps}):
        steps = [step for step in found.steps if step.line == line]
        low = [min(s.start_pa, s.end_pa) - min(s.setpoint_pa) for s in steps]
        high = [max(s.start_pa, s.end_pa) - max(s.setpoint_pa) for s in steps]
        noise = [s.noise_pa for s in steps]
        rows.append([line, len(steps), *(figure(float(np.median(v)) / 1e3, 2) for v in (low, high, noise))])
    header = ("line", "steps", "reading - set point, low, kPa", "the same, high, kPa", "noise, kPa")
    return table(header, rows)


def pump_runs(data: Path) -> list[PumpRun]:
    """Runs of the pump, with the gains of the controller."""
    runs = []
    for name, (kp, ki) in GAINS.items():
        control = InnerPI(kp / FULL / 1e3, ki / FULL / 1e3, FULL_ABOVE_PA)
        runs.append(read_pump_run(data / "softbot_pressure_loop" / f"{name}.csv", control))
    return runs


def pumps(data: Path, options: Options) -> list[Pumped]:
    """Each run judged by the fit to the other ones."""
    runs = options.pick(pump_runs(data), pump_runs(data)[:2])
    pumped = []
    for run in runs:
        options.say(run.run)
        others, _ = fit_pump([other for other in runs if other is not run], VOLUME_M3)
        own, _ = fit_pump([run], VOLUME_M3)
        pumped.append(Pumped(run, others, own))
    return pumped


def t63(run: PumpRun, model: PumpModel) -> float:
    """Time of the model to 63.2 % of its own way, from its start to its last tenth [s]."""
    t, pressure, _ = pump_response(model, run)
    levels = float(pressure[0]), float(np.median(pressure[t >= 0.9 * run.t[-1]]))
    return crossing(t, part_of(pressure, levels))


def pump_text(pumped: list[Pumped]) -> str:
    """Table of the runs of the pump."""
    rows = []
    good = 0
    for one in pumped:
        run, measured, model = one.run, one.run.t63_s, t63(one.run, one.others)
        good += abs(model / measured - 1.0) <= air.GOOD
        rms = [
            float(np.sqrt(np.mean(errors(run, pump_response(m, run)) ** 2))) for m in (one.others, one.own)
        ]
        rows.append(
            [
                run.run,
                figure(run.levels_pa[1] / 1e3),
                figure(measured, 2),
                figure(model, 2),
                f"{round(100 * (model / measured - 1)):+d} %",
                figure(rms[0] / 1e3, 2),
                f"{round(100 * (t63(run, one.own) / measured - 1)):+d} %",
                figure(rms[1] / 1e3, 2),
                figure(one.own.valves.supply_pa / 1e3),
            ]
        )
    header = (
        "run",
        "level reached, kPa",
        "t63, s",
        "by the fit to the other runs, s",
        "error",
        "RMS, kPa",
        "error of its own fit",
        "RMS, kPa",
        "stall pressure, kPa",
    )
    median = float(np.median([abs(t63(one.run, one.others) / one.run.t63_s - 1) for one in pumped]))
    return (
        f"softbot_pressure_loop: a pump under PI control, set point 35 kPa. By the fit to the other runs "
        f"{good} of {len(pumped)} runs are within 20 %, the median error is {100 * median:.0f} %.\n\n"
        + table(header, rows)
    )
