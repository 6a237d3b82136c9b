"""`soro identify` on recordings of air alone: what is written, printed and refused, and the exit status."""

from pathlib import Path

import numpy as np
import pytest
import typer
import yaml
from test_fit_command import recorded
from typer.testing import CliRunner

from soro_core.errors import ConfigError
from soro_core.pneumatics import RegulatorModel, ValveModel
from soro_core.twin.config import TwinConfig
from soro_lab.commands.identify import identify
from soro_lab.identification.pump import PumpModel, PumpRun, pump_response
from tests.refused import fails

app = typer.Typer()
app.command()(identify)

STEPS = "pressures: {columns: {a: pm_a}}\ncommands: {columns: {a: pd_a}}\n"
PUMP = "time: {column: t}\npressures: {columns: {a: p}}\nduty: {columns: {a: pwm}, full: 255}\n"
LEAK = "pressures: {columns: {a: p}}\n"


def call(tmp_path: Path, columns: str, *arguments: object) -> tuple[object, Path]:
    (tmp_path / "map.yaml").write_text(columns, encoding="utf-8")
    out = tmp_path / "found.yaml"
    given = [*map(str, arguments), "--columns", str(tmp_path / "map.yaml"), "--out", str(out)]
    return CliRunner().invoke(app, given, env={"COLUMNS": "200"}), tmp_path / "found_regulators.yaml"


def table(path: Path, **columns: np.ndarray) -> Path:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, fmt="%.6g", delimiter=",", header=",".join(columns), comments="")
    return path


def leaking(path: Path, rate: float = 0.02) -> Path:
    t = np.arange(0.0, 60.0, 0.1)
    noise = np.random.default_rng(2).normal(scale=50.0, size=t.size)
    return table(path, t=t, p=200e3 * np.exp(-rate * t) + noise)


def pumped(path: Path, full: float, stall_pa: float = 40e3) -> Path:
    valve = ValveModel(
        fill_m3_s_pa=1.2e-10, vent_m3_s_pa=0.0, leak_m3_s_pa=3e-11, supply_pa=stall_pa, band_pa=1.0
    )
    t = np.arange(0.0, 5.0, 0.02)
    bare = PumpRun("r", None, np.nan, t, np.zeros_like(t), np.full_like(t, full))
    times, pressure, _ = pump_response(PumpModel(valve, 30e-6, 0.06), bare)
    noise = np.random.default_rng(round(100 * full)).normal(scale=30.0, size=t.size)
    return table(path, t=t, p=np.interp(t, times, pressure) + noise, pwm=255.0 * bare.duty)


def test_steps_give_regulator_and_valve_with_errors_of_runs_held_out(tmp_path: Path) -> None:
    runs = [recorded(tmp_path / f"run{seed}.csv", seed) for seed in (1, 2)]
    done, out = call(tmp_path, STEPS, *runs)
    assert done.exit_code == 0, done.output
    assert "8 steps; left out: none" in done.output
    found = yaml.safe_load(out.read_text(encoding="utf-8"))
    regulator = RegulatorModel.model_validate(found["regulator"])
    assert regulator.tau_s == pytest.approx(0.2, rel=0.05)
    assert regulator.vent_tau_s == pytest.approx(0.6, rel=0.05)
    assert TwinConfig.model_validate(found["twin"]).regulator == regulator
    tau = found["identified"]["regulator"]["numbers"]["tau_s"]
    assert tau["value"] == pytest.approx(regulator.tau_s, rel=1e-2)
    assert 0.0 < tau["deviation"] < 0.02
    assert 0.0 < found["identified"]["regulator"]["held_out_error"] < 0.01
    assert not (tmp_path / "found.yaml").exists()
    again, _ = call(tmp_path, STEPS, *runs)
    assert isinstance(again.exception, ConfigError)
    assert again.exception.got == str(out)


def test_steps_that_no_model_meets_are_not_accepted(tmp_path: Path) -> None:
    done, _ = call(tmp_path, STEPS, recorded(tmp_path / "run1.csv", 1), "--accept", "0.001")
    assert done.exit_code == 1
    assert "regulators" in done.stderr


def test_nothing_is_held_out_of_one_step(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run1.csv", 1)
    # The first rise alone: 10 s of rows of 50 ms.
    path.write_text("\n".join(path.read_text().splitlines()[:200]) + "\n")
    done, out = call(tmp_path, STEPS, path)
    assert done.exit_code == 0
    assert "nothing could be held out" in done.stderr
    assert yaml.safe_load(out.read_text())["identified"]["regulator"]["held_out_error"] is None


def test_a_pump_comes_back_from_its_recorded_duty(tmp_path: Path) -> None:
    runs = [pumped(tmp_path / f"run{k}.csv", full) for k, full in enumerate((1.0, 0.8, 0.6))]
    done, out = call(tmp_path, PUMP, *runs)
    assert done.exit_code == 0, done.output
    assert "t63 within 20 % in 3 of 3 runs" in done.output
    numbers = yaml.safe_load(out.read_text())["identified"]["pump"]["numbers"]
    assert numbers["fill_m3_s_pa"]["value"] == pytest.approx(1.2e-10, rel=0.05)
    assert numbers["supply_pa"]["value"] == pytest.approx(40e3, rel=0.05)


def test_a_pump_of_which_each_run_differs_is_not_accepted(tmp_path: Path) -> None:
    runs = [pumped(tmp_path / f"run{k}.csv", 1.0, stall) for k, stall in enumerate((20e3, 60e3))]
    done, _ = call(tmp_path, PUMP, *runs)
    assert done.exit_code == 1
    assert "pump" in done.stderr


def test_a_leak_is_written_as_law_and_as_conductance_of_a_twin(tmp_path: Path) -> None:
    done, out = call(tmp_path, LEAK, leaking(tmp_path / "closed.csv"))
    assert done.exit_code == 0, done.output
    found = yaml.safe_load(out.read_text())
    (leak,) = found["identified"]["leaks"].values()
    assert leak["law"] == "diffusive"
    assert leak["numbers"]["rate_1_s"]["value"] == pytest.approx(0.02, rel=0.01)
    assert TwinConfig.model_validate(found["twin"]).valve.leak_m3_s_pa > 0.0


def test_a_leak_that_creates_air_is_not_accepted(tmp_path: Path) -> None:
    done, _ = call(tmp_path, LEAK, leaking(tmp_path / "closed.csv", -0.005))
    assert done.exit_code == 1
    assert "creates air" in done.stderr


def test_gaps_are_counted_and_do_not_matter(tmp_path: Path) -> None:
    path = leaking(tmp_path / "closed.csv")
    lines = path.read_text().splitlines()
    for row in range(50, 60):
        lines[row] = lines[row].split(",")[0] + ",nan"
    path.write_text("\n".join(lines) + "\n")
    done, out = call(tmp_path, LEAK, path)
    assert done.exit_code == 0
    assert "10 not finite of 600 samples" in done.stderr
    (leak,) = yaml.safe_load(out.read_text())["identified"]["leaks"].values()
    assert leak["numbers"]["rate_1_s"]["value"] == pytest.approx(0.02, rel=0.01)


def test_bad_input_is_refused_with_its_place(tmp_path: Path) -> None:
    short = recorded(tmp_path / "short.csv", 1, seconds=1.5)
    done, _ = call(tmp_path, STEPS, short)
    assert isinstance(done.exception, ConfigError)
    assert "no step to fit" in done.exception.got
    path = leaking(tmp_path / "closed.csv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], *lines[300:], *lines[1:300]]) + "\n")
    done, _ = call(tmp_path, LEAK, path)
    with fails(ConfigError, where=str(path), key="pressure"):
        raise done.exception
    done, _ = call(tmp_path, LEAK, tmp_path)
    with fails(ConfigError, key="ROBOT"):
        raise done.exception
    done, _ = call(tmp_path, LEAK, "asu_two_segment")
    with fails(ConfigError, key="RECORDINGS"):
        raise done.exception
    flat = table(
        tmp_path / "flat.csv", t=np.arange(0.0, 5.0, 0.02), p=np.full(250, 5e3), pwm=np.full(250, 255.0)
    )
    done, _ = call(tmp_path, PUMP, flat)
    with fails(ConfigError, where="flat", key="a"):
        raise done.exception


def test_stamps_of_set_points_of_their_own_count(tmp_path: Path) -> None:
    """A step begins when its set point comes, not at the reading after it."""
    from soro_lab.identification.recording import Recording, Series
    from soro_lab.identification.regulators.sources import step_records
    from soro_lab.identification.steps import find_steps

    t = np.arange(0.0, 20.0, 0.25)
    command = Series("command", np.array([0.0, 5.1, 12.0]), np.array([[0.0], [50e3], [50e3]]))
    pressure = 50e3 * (1.0 - np.exp(-np.maximum(t - 5.1, 0.0) / 0.5))
    rng = np.random.default_rng(0)
    reading = Series("pressure", t, (pressure + rng.normal(scale=10.0, size=t.size))[:, None])
    (record,) = step_records([Recording("r", ("a",), reading, command)])
    (step,) = find_steps(record).steps
    assert step.t63_s == pytest.approx(0.5, abs=0.03)


def test_a_ramp_is_not_a_step() -> None:
    from soro_lab.identification.steps import PressureRecord, find_steps

    t = np.arange(0.0, 12.0, 0.05)
    for rise_s, steps in ((0.3, 1), (1.0, 0)):
        setpoint = 50e3 * np.clip((t - 3.0) / rise_s, 0.0, 1.0)[:, None]
        late = np.interp(t - 0.4, t, setpoint[:, 0])  # a pressure that is there with the set point is no step
        pressure = (late + np.sin(99.0 * t))[:, None]
        found = find_steps(PressureRecord("r", t, ("a",), setpoint, pressure))
        assert len(found.steps) == steps
        assert found.left_out["a ramp"] == 1 - steps
