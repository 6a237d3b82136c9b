"""The second part of the table of extremes: the loop as a whole, and the air; stated beforehand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

from soro_core.pneumatics import ValveModel
from tests.apparatus.extremes.air import Breathe, Meet
from tests.apparatus.extremes.arms import Arm
from tests.apparatus.extremes.cell import Cell, Must
from tests.apparatus.extremes.loop import ClosedLoop


def loop_cells() -> list[Cell]:
    """Every cell of the loop, in the order of the table."""
    return [*_rates(), *_lags(), *_samples(), *_meetings(), *_volumes()]


def _rates() -> Iterator[Cell]:
    group = "Loop: sampling, 52 ms of lag"
    for rate in (50.0, 100.0, 200.0, 500.0, 1000.0):
        task = ClosedLoop(rate_hz=rate)
        yield Cell(group, f"{rate:g} Hz", "10 s", Must.FINISH, task, quick=False)
    for rate, duration in ((50.0, 6.0), (1000.0, 2.0)):
        # In two seconds the arm is only on its way up.
        task = ClosedLoop(rate_hz=rate, duration_s=duration, tracks=duration > 5.0)
        yield Cell(group, f"{rate:g} Hz", f"{duration:g} s", Must.FINISH, task)


def _lags() -> Iterator[Cell]:
    """The controller believes in 52 ms."""
    for lag, rate in product((0.0, 0.015, 0.1, 0.2), (50.0, 200.0)):
        # With four times the lag it need not track any more, only stay sane.
        task = ClosedLoop(rate_hz=rate, lag_s=lag, tracks=lag <= 0.1)
        group = "Loop: lag of the regulators, 52 ms believed"
        yield Cell(group, f"{1e3 * lag:g} ms", f"{rate:g} Hz", Must.FINISH, task, quick=False)


def _samples() -> Iterator[Cell]:
    group = "Loop: samples, 200 Hz"
    lossy = ClosedLoop(drop=0.2)
    cases = {
        "20 % dropped": lossy,
        "20 % dropped, 2 % far off": replace(lossy, outlier=0.02),
        "20 % dropped, at 20 % of the ticks no numbers": replace(lossy, no_number=0.2),
    }
    for name, task in cases.items():
        short = replace(task, duration_s=6.0)
        yield Cell(group, name, "6 s", Must.FINISH, short, quick=not task.outlier)
        yield Cell(group, name, "20 s", Must.FINISH, replace(task, duration_s=20.0), quick=False)


def _meetings() -> Iterator[Cell]:
    """From tenths of a microlitre to a litre, 10 us to 20 ms; neither past the goal nor to and fro."""
    group = "Air: flow as the pressures meet"
    ways = {
        "fills to the supply": (0.0, 400e3, 150e3),
        "vents to the exhaust": (90e3, -10e3, 0.0),
        "fills to its set point": (0.0, 30e3, 30e3),
        "vents to its set point": (90e3, 30e3, 30e3),
    }
    for (name, way), volume, dt, exponent in product(
        ways.items(), (1e-10, 1e-7, 3e-5, 1e-3), (1e-5, 1e-3, 5e-3, 20e-3), (1.0, 1.4)
    ):
        task = Meet(volume, dt, *way, valve=ValveModel(polytropic=exponent, band_pa=1.0))
        row = f"{name}, {1e6 * volume:g} ml, n = {exponent:g}"
        yield Cell(group, row, f"{1e3 * dt:g} ms", Must.FINISH, task, quick=dt in (1e-5, 20e-3))


def _volumes() -> Iterator[Cell]:
    """Air shut in by valves, and valves that step to full scale, in soft and stiff arms."""
    group = "Air: volume that changes with the arm, shut valves"
    for n, modulus, turns, exponent in product((1, 4, 16), (10e3, 1e6, 100e6), (0.05, 0.5), (1.0, 1.4)):
        for dt in (1e-5, 1e-3, 5e-3):
            task = Breathe(Arm(n, modulus, loss_s=1e-3), turns, dt, polytropic=exponent)
            row = f"{n} links, {modulus / 1e6:g} MPa, {turns:g} turns a link, n = {exponent:g}"
            quick = dt == 5e-3 and n == 4 and turns == 0.05
            yield Cell(group, row, f"{1e3 * dt:g} ms", Must.FINISH, task, quick)
    group = "Air: volume that changes with the arm, valves that step"
    for n, modulus, scale in product((1, 4, 16), (100e3, 1e6, 100e6), (0.1, 1.0)):
        for dt, steps in ((1e-3, 1000), (5e-3, 200), (20e-3, 50)):
            task = Breathe(Arm(n, modulus, loss_s=1e-2), 0.05, dt, steps, shut=False, setpoint=scale)
            row = f"{n} links, {modulus / 1e6:g} MPa, {scale:g} of full scale"
            must = Must.FINISH if dt <= 5e-3 else Must.FINISH_OR_STOP
            yield Cell(group, row, f"{1e3 * dt:g} ms", must, task, quick=dt > 1e-3 and n == 4)
