"""`soro fit pressures` on a recording made here: the table, the block to paste, the picture."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from soro_core.errors import ConfigError
from soro_core.pneumatics import RegulatorModel, initial_state, reading, step
from soro_lab.commands.fit import app

TRUE = RegulatorModel(
    delay_s=0.1, tau_s=0.2, vent_tau_s=0.6, hysteresis_pa=0.0, maximum_pa=60e3, reading_resolution_pa=0.0
)
DT = 0.05


def recorded(path: Path, seed: int, seconds: float = 5.0) -> Path:
    rng = np.random.default_rng(seed)
    state = initial_state(TRUE, 1)
    rows = ["t,pd_a,pm_a"]
    levels = np.repeat([0.0, 50e3, 0.0, 30e3, 0.0], round(seconds / DT))
    for k, level in enumerate(levels):
        rows.append(f"{k * DT:.3f},{level},{reading(TRUE, state, rng)[0]:.1f}")
        state = step(TRUE, state, np.array([level]), DT)
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_recording_gives_a_block_to_paste(tmp_path: Path) -> None:
    records = [str(recorded(tmp_path / f"run{seed}.csv", seed)) for seed in (1, 2)]
    picture = tmp_path / "fit.png"
    done = CliRunner().invoke(app, ["pressures", *records, "--picture", str(picture)], env={"COLUMNS": "200"})
    assert done.exit_code == 0, done.output
    assert "8 steps; left out: none" in done.output
    assert "4 of 4" in done.output
    block = done.output.split("# lag for each way, parameters for all lines\n")[1].split("\n# ")[0]
    regulator = RegulatorModel.model_validate(yaml.safe_load(block)["regulator"])
    assert regulator.delay_s == pytest.approx(TRUE.delay_s, abs=0.02)
    assert regulator.tau_s == pytest.approx(TRUE.tau_s, rel=0.05)
    assert regulator.vent_tau_s == pytest.approx(TRUE.vent_tau_s, rel=0.05)
    assert picture.stat().st_size > 10_000


def test_a_recording_without_steps_is_refused_with_what_it_lacks(tmp_path: Path) -> None:
    path = recorded(tmp_path / "short.csv", 1, seconds=1.5)
    done = CliRunner().invoke(app, ["pressures", str(path)])
    assert isinstance(done.exception, ConfigError)
    assert "no step to fit" in str(done.exception)
    assert "not held long enough" in done.exception.got
