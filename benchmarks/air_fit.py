"""Recorded step responses of real regulators and a real pump, fitted by the regulator and flow models."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks import air_picture
from benchmarks.air_picture import Pumped
from benchmarks.options import Options
from benchmarks.report import figure, table
from soro_lab.identification import regulator_fit as air
from soro_lab.identification.pump import (
    InnerPI,
    PumpRun,
    errors,
    fit_pump,
    model_t63,
    pump_response,
)
from soro_lab.identification.recording import read_csv
from soro_lab.identification.records import read_columns
from soro_lab.identification.regulators.leak import find_leak
from soro_lab.identification.regulators.sources import leak_runs
from soro_lab.identification.steps import FoundSteps, Step, find_steps, read_pressures

# Full duty cycle in recordings, 8 bit.
FULL = 255.0
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
# Month and day in the names of the runs.
_DAY = re.compile(r"2023_([a-z]+)_?(\d+)")


def run(options: Options) -> str:
    """Fit both data sets; a picture, tables, and parameters to paste."""
    data = Path(os.environ.get("SORO_DATA", DATA))
    if not (data / "asu_two_segment").is_dir():
        return f"Not measured: no data set in {data} (SORO_DATA names another folder)."
    found = regulators(data, options.pick("*", "2023_jan_23*"))
    fits: list[air.AirFit] = []
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
            splits(found, options),
            pump_text(pumped),
            leaks(data, options),
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
                figure(model.valves.vent_band_pa / 1e3),
                figure(model.delay_s),
                figure(model.vent_delay_s),
            ]
        )
    header = (
        "flow, line",
        "C fill, l/(s bar)",
        "C vent, l/(s bar)",
        "band, kPa",
        "vent band, kPa",
        "delay, s",
        "vent delay, s",
    )
    given = f"{1e6 * VOLUME_M3:g} ml and a supply of {SUPPLY_PA / 1e3:g} kPa"
    return (
        f"{table(header, rows)}\n\nFor a volume of {given}, which are not published: only C over volume "
        "counts, and steps tell next to nothing of the supply."
    )


def splits(found: FoundSteps, options: Options) -> str:
    """Flow with one band and with two, judged on what other parts of the runs have not seen."""
    ways: dict[str, Callable[[Step], str]] = {
        "each run": lambda step: step.run,
        "each session": lambda step: step.run.rsplit("_r", 1)[0],
        "each day": lambda step: "_".join(_DAY.findall(step.run)[0]),
        "each month": lambda step: _DAY.findall(step.run)[0][0],
        "every other run": lambda step: str(sorted({s.run for s in found.steps}).index(step.run) % 2),
    }
    rows = []
    for name, group_of in options.pick(ways, {}).items():
        for kind in air.kinds(VOLUME_M3, SUPPLY_PA)[-3:]:
            options.say(f"{kind.name}, without {name}")
            judged = air.fit_air(found.steps, kind, group_of).held_out
            cells = []
            for fill in (True, False):
                result = air.score(judged, fill)
                if result is not None:
                    low, high = wilson(result.within, result.n)
                    share = f"{100 * result.within / result.n:.0f} % ({100 * low:.0f} to {100 * high:.0f})"
                    cells += [f"{result.within} of {result.n}", share]
            rows.append([name, kind.name, *cells])
    header = ("held out in turn", "parameters for each line", *2 * ("within 20 %", "share, 95 % interval"))
    text = "t63 of fills, then of vents, by what is held out:"
    return f"{text}\n\n{table(header, rows)}" if rows else ""


def wilson(good: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """Interval of a share by Wilson, for independent samples."""
    share, width = good / n, z * z / n
    middle = (share + 0.5 * width) / (1.0 + width)
    half = z * float(np.sqrt(share * (1.0 - share) / n + 0.25 * width / n)) / (1.0 + width)
    return middle - half, middle + half


def leaks(data: Path, options: Options) -> str:
    """Closed chambers: errors of each law on the second half, fitted to the first."""
    found = []
    for path in sorted((data / "chamber_leak").glob("*.csv")):
        options.say(path.stem)
        found += [find_leak(one) for one in leak_runs([read_csv(path, "chamber_leak", None)])]
    if not found:
        return ""
    names = list(found[0].errors)
    rows = [
        [
            one.run.run,
            figure(one.closed_s),
            *(f"{100 * one.errors[name]:.2f} %" for name in names),
            one.law.name,
            f"{100 * one.error:.2f} %",
        ]
        for one in found
    ]
    header = ("chamber", "closed at, s", *names, "law chosen on the first half", "its error")
    return (
        "chamber_leak: RMS error on the second half, over the pressure at the start, of laws fitted to the "
        f"first half.\n\n{table(header, rows)}"
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


def read_pump_run(path: Path, control: InnerPI) -> PumpRun:
    """Read a run with the columns Time [s], Target and Pressure [kPa gauge] and PWM [0 to 255]."""
    columns = read_columns(path, ("Time", "Target", "Pressure", "PWM"))
    return PumpRun(
        path.stem,
        control,
        1e3 * float(columns["Target"][-1]),
        columns["Time"],
        1e3 * columns["Pressure"],
        columns["PWM"] / FULL,
    )


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


def pump_text(pumped: list[Pumped]) -> str:
    """Table of the runs of the pump."""
    rows = []
    good = 0
    for one in pumped:
        run, measured, model = one.run, one.run.t63_s, model_t63(one.others, one.run)
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
                f"{round(100 * (model_t63(one.own, run) / measured - 1)):+d} %",
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
    median = float(np.median([abs(model_t63(one.others, one.run) / one.run.t63_s - 1) for one in pumped]))
    return (
        f"softbot_pressure_loop: a pump under PI control, set point 35 kPa. By the fit to the other runs "
        f"{good} of {len(pumped)} runs are within 20 %, the median error is {100 * median:.0f} %.\n\n"
        + table(header, rows)
    )
