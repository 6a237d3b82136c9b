"""Steps are found in a recording that has every fault of a real one, and what is left out is counted."""

from pathlib import Path

import numpy as np
import pytest

from soro_core.errors import ConfigError
from soro_lab.identification.steps import (
    T63,
    PressureRecord,
    StepLimits,
    crossing,
    find_steps,
    read_pressures,
)
from tests.refused import fails

DT = 0.02
LAGS = {"fill": 0.3, "vent": 0.9}


def record(
    setpoint: np.ndarray, seed: int = 0, noise_pa: float = 200.0, offset_pa: float = 0.0
) -> PressureRecord:
    """One line with a lag for each way behind a set point that is given at every row, and an idle line."""
    rng = np.random.default_rng(seed)
    pressure = np.empty_like(setpoint)
    p = setpoint[0]
    for k, wanted in enumerate(setpoint):
        p += (wanted - p) * -np.expm1(-DT / LAGS["fill" if wanted > p else "vent"])
        pressure[k] = p
    seen = np.column_stack([pressure + offset_pa, np.full(len(setpoint), 7e3)])
    seen += rng.normal(scale=noise_pa, size=seen.shape)
    t = DT * np.arange(len(setpoint))
    return PressureRecord("run", t, ("a", "idle"), np.column_stack([setpoint, np.full(len(t), 7e3)]), seen)


def held(*levels: tuple[float, float]) -> np.ndarray:
    """Levels [Pa], each for so long [s]."""
    return np.concatenate([np.full(round(seconds / DT), level) for level, seconds in levels])


def test_fill_and_vent_are_found_with_their_times_and_levels() -> None:
    found = find_steps(record(held((10e3, 2), (60e3, 6), (10e3, 8)), offset_pa=3e3))
    fill, vent = found.steps
    assert (fill.fill, vent.fill) == (True, False)
    assert fill.line == "a"
    assert fill.setpoint_pa == (10e3, 60e3)
    assert fill.start_pa == pytest.approx(13e3, abs=100)
    assert fill.end_pa == pytest.approx(63e3, abs=100)
    assert fill.noise_pa == pytest.approx(200, rel=0.2)
    assert fill.t63_s == pytest.approx(LAGS["fill"], rel=0.1)
    assert vent.t63_s == pytest.approx(LAGS["vent"], rel=0.1)
    assert not found.left_out
    assert (found.stale, found.missing) == (0, 0)


def test_repeated_readings_are_left_out_and_counted() -> None:
    clean = record(held((10e3, 2), (60e3, 6)))
    stale = clean.pressure.copy()
    for k in range(len(stale)):
        stale[k] = stale[k - k % 4]
    found = find_steps(PressureRecord("run", clean.t, clean.lines, clean.setpoint, stale))
    assert found.stale == pytest.approx(0.75 * found.rows, abs=2)
    (step,) = found.steps
    assert np.all(np.diff(step.t) == pytest.approx(4 * DT))
    assert step.t63_s == pytest.approx(LAGS["fill"], rel=0.15)


def test_missing_readings_are_left_out_and_counted() -> None:
    run = record(held((10e3, 2), (60e3, 6)))
    run.pressure[::3, 0] = np.nan
    found = find_steps(run)
    assert found.missing == len(run.pressure[::3])
    (step,) = found.steps
    assert np.isfinite(step.pressure).all()
    assert step.t63_s == pytest.approx(LAGS["fill"], rel=0.15)
    run.pressure[50:99, 0] = np.nan
    assert find_steps(run).left_out == {"pressure missing": 1}


def test_a_command_that_flickers_is_one_step() -> None:
    run = record(held((10e3, 2), (60e3, 6)))
    run.setpoint[94:98, 0] = 60e3  # comes, goes, and comes to stay
    (step,) = find_steps(run).steps
    assert step.setpoint_pa == (10e3, 60e3)
    assert step.t63_s == pytest.approx(LAGS["fill"], rel=0.15)
    back = find_steps(record(held((10e3, 2), (60e3, 0.04), (10e3, 6))))
    assert not back.steps
    assert not back.left_out


def test_what_is_no_step_is_counted_with_its_reason() -> None:
    cases = {
        "too small": held((10e3, 2), (15e3, 6)),
        "not held long enough": held((10e3, 2), (60e3, 2)),
        "not settled": held((10e3, 2), (60e3, 6), (10e3, 3.1)),
    }
    for reason, setpoint in cases.items():
        run = record(setpoint)
        assert find_steps(run).left_out[reason] == 1, reason
    run = record(held((10e3, 2), (60e3, 6)))
    run.pressure[:, 0] = 10e3
    assert find_steps(run).left_out == {"no response": 1}


def test_a_ramp_that_the_pressure_follows_is_no_step() -> None:
    """The set point takes 0.4 s, less than a flicker; a pressure without lag is there when it is."""
    ramp = np.concatenate([held((10e3, 2)), np.linspace(10e3, 60e3, 20), held((60e3, 6))])
    t = DT * np.arange(len(ramp))
    followed = PressureRecord("run", t, ("a",), ramp[:, None], ramp[:, None] + 1.0 * np.sin(t)[:, None])
    found = find_steps(followed)
    assert not found.steps
    assert found.left_out == {"a ramp": 1}


def test_a_sensor_that_froze_while_the_pressure_moved_is_no_response() -> None:
    run = record(held((10e3, 2), (60e3, 6)))
    moving = (run.t >= 2.0) & (run.t < 2.8)
    run.pressure[moving] = run.pressure[np.argmax(moving)]
    assert find_steps(run).left_out == {"frozen while it moved": 1}
    at_rest = record(held((10e3, 2), (60e3, 6)))
    rest = at_rest.t < 1.96
    at_rest.pressure[rest] = at_rest.pressure[0]
    assert len(find_steps(at_rest).steps) == 1


def test_a_larger_limit_leaves_out_more() -> None:
    run = record(held((10e3, 2), (60e3, 6)))
    assert find_steps(run, StepLimits(change_pa=55e3)).left_out == {"too small": 1}


def test_crossing_is_between_samples_and_ignores_one_spike() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    assert crossing(t, np.array([0.0, 0.9, 0.1, 0.8, 0.9]), 0.5) == pytest.approx(2 + 0.4 / 0.7)
    assert np.isnan(crossing(t, np.zeros(5), 0.5))
    assert pytest.approx(0.632, abs=1e-3) == T63


GOOD = "t,pd_a,pm_a,other\n0,1,2,x\n1,1,,x\n2,5,nan,x\n"


def test_a_file_is_read_with_missing_pressures(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(GOOD, encoding="utf-8")
    run = read_pressures(path)
    assert (run.run, run.lines) == ("run", ("a",))
    np.testing.assert_array_equal(run.pressure[:, 0], [2, np.nan, np.nan])


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (GOOD.replace("pm_a", "pm_b"), ("pm_a",)),
        (GOOD.replace("pd_a", "a"), ("", "pd_NAME")),
        (GOOD.replace("\n1,1", "\n1,").replace("\n2,5", "\n2,"), ("pd_a",)),
        (GOOD.replace("1,1,,", "1,1,inf,").replace("nan", "inf"), ("pm_a",)),
        (GOOD.replace("\n2,", "\n0,").replace("\n1,", "\n0,"), ("t", "rise")),
    ],
)
def test_a_bad_file_is_named_in_one_line(tmp_path: Path, text: str, found: tuple[str, ...]) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="utf-8")
    with fails(ConfigError, *found[1:], where=str(tmp_path / "run.csv"), key=found[0]):
        read_pressures(path)
