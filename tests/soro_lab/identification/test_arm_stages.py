"""The whole way on an arm whose numbers no file has: every number is found within its own error bar."""

from dataclasses import replace

import numpy as np
import pytest
from made_arm import record
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from soro_core import load_robot
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.parameters import numbers_of, with_numbers
from soro_lab.identification.arm.laws import LAWS, plain
from soro_lab.identification.arm.robot_yaml import number_table, robot_text
from soro_lab.identification.arm.stages import ArmIdentification, IdentificationOptions, identify

TRUTH = {
    "link0/k_e": 420.0,
    "link0/k_b": 7.5e-3,
    "link0/damping_e": 0.03,
    "link0/damping_b": 2e-7,
    "link0/gain": 1.25,
    "link0/arm": 0.9,
    "link0/area_slope": -2.0,
    "link0/chamber1/gain": 0.93,
    "link0/chamber2/gain": 1.08,
}


@pytest.fixture(scope="module")
def guess() -> Robot:
    return with_numbers(plain(load_robot("tue_three_bellow")), {"link0/damping_b": 1e-7})


@pytest.fixture(scope="module")
def found(guess: Robot) -> ArmIdentification:
    laws = tuple(law for law in LAWS if law.name in ("area slope", "creep"))
    options = IdentificationOptions(
        dt_s=0.005, rate_hz=20.0, laws=laws, is_constant=True, starts=1
    )  # as the made arm
    return identify(guess, [record(with_numbers(guess, TRUTH))], options)


@pytest.mark.slow
def test_the_law_of_the_arm_is_chosen(found: ArmIdentification) -> None:
    assert found.choice is not None
    assert [law.name for law in found.choice.chosen.laws] == ["area slope"]


def test_every_number_is_within_its_error_bar_or_three_per_cent(found: ArmIdentification) -> None:
    assert set(TRUTH) <= set(found.solution.values) | set(found.kept)
    for name, truth in TRUTH.items():
        if name in found.kept:
            continue
        value, deviation = found.solution.values[name], found.certainty.deviations[name]
        apart = abs(np.log(value / truth)) if truth > 0 else abs(value - truth)
        assert apart < max(2.5 * deviation, 0.03), f"{name}: {value} +- {deviation}, is {truth}"
    sure = [name for name in TRUTH if found.certainty.deviations.get(name, 9.0) < 0.05]
    assert len(sure) >= 6


def test_the_frame_of_the_tracker_is_found(found: ArmIdentification) -> None:
    turn = Rotation.from_rotvec([found.solution.values[f"frame/tracker/turn_{x}"] for x in "xyz"])
    assert (turn.inv() * Rotation.from_rotvec([0.3, -0.2, 1.1])).magnitude() < 0.01
    offset = [found.solution.values[f"frame/tracker/offset_{x}"] for x in "xyz"]
    np.testing.assert_allclose(offset, [0.4, 0.1, 0.8], atol=1e-3)


@pytest.mark.slow
def test_what_was_held_out_is_predicted(found: ArmIdentification) -> None:
    assert found.held_out
    assert found.held_out_share < 0.03


def test_the_file_loads_and_says_where_each_number_comes_from(
    found: ArmIdentification, guess: Robot, tmp_path
) -> None:
    path = tmp_path / "arm.yaml"
    path.write_text(robot_text(found, ["made"]), encoding="utf-8")
    loaded = numbers_of(load_robot(path))
    for name, number in numbers_of(found.robot).items():
        assert loaded[name].value == pytest.approx(number.value, rel=1e-6), name
    table = "\n".join(number_table(found))
    assert all(name in table for name in TRUTH)
    assert "identified" in table


def _soro(*words: str):
    from soro_ros.cli import application

    return CliRunner().invoke(application(), ["identify", *words])


@pytest.mark.parametrize(
    ("words", "field"),
    [
        (("tue_three_bellow", "a.csv", "--out", "new.yaml"), "--columns"),
        (("tue_three_bellow", "a.csv", "--out", "new.txt"), "--out"),
        (("tue_three_bellow", "a.csv", "--out", "here.yaml"), "--out"),
        (("tue_three_bellow", "bag", "--out", "new.yaml", "--laws", "magic"), "--laws"),
    ],
)
def test_wrong_use_names_the_option(words: tuple[str, ...], field: str, tmp_path, monkeypatch) -> None:
    from soro_core.errors import ConfigError

    monkeypatch.chdir(tmp_path)
    (tmp_path / "here.yaml").write_text("kept", encoding="utf-8")
    result = _soro(*words)
    assert isinstance(result.exception, ConfigError)
    assert result.exception.key == field
    assert (tmp_path / "here.yaml").read_text(encoding="utf-8") == "kept"
    assert not (tmp_path / "new.yaml").exists()


@pytest.mark.slow
def test_no_fit_sees_a_run_that_is_held_out_by_name(guess: Robot) -> None:
    made = record(with_numbers(guess, TRUTH), hold_s=0.6)
    kept = replace(made, name="kept")
    stronger = replace(kept, pressure=replace(kept.pressure, values=1.5 * kept.pressure.values))
    options = IdentificationOptions(
        dt_s=0.01, rate_hz=10.0, laws=(), most=3, is_constant=True, starts=1, hold_out=("kept",)
    )
    one, other = (identify(guess, [made, each], options) for each in (kept, stronger))
    assert one.solution.values == other.solution.values
    assert [case.name for case in one.problem.cases] == ["made"]
    assert [error.case for error in other.held_out] == ["kept"]
    assert other.held_out_share > 2.0 * one.held_out_share
