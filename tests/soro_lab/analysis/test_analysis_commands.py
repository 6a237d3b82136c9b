"""`soro reach` and `soro place-sensors` from the outside: what they write, and what they refuse."""

import json

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from soro_core import SoftArm, load_robot
from soro_core.control import reachable_workspace as reachable
from soro_core.errors import ConfigError
from soro_lab.scene import Scene
from soro_ros.cli import application


@pytest.fixture
def soro(tmp_path, monkeypatch):
    monkeypatch.setattr(reachable, "MOST", 8)
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(application(), list(arguments))


def test_reach_writes_picture_and_numbers(soro, tmp_path):
    result = soro("reach", "tue_three_bellow", "--load", "10g", "--json", "reach.json")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "tue_three_bellow_reach.png").stat().st_size > 10_000
    written = json.loads((tmp_path / "reach.json").read_text())
    assert len(written["tips"]) == 8
    assert [way["chambers"] for way in written["ways"]][-1] == "all chambers"
    place = written["ways"][0]["places"][-1]
    arm = SoftArm(load_robot("tue_three_bellow").replace(tip_mass=0.01))
    assert place["pressure_pa"] == [90e3, 0.0, 0.0]
    assert place["tip_m"] == pytest.approx(arm.pose(place["q"], arm.length)[:3, 3])
    softest = np.linalg.eigvalsh(place["compliance_m_n"])[-1]
    assert place["stiffness_n_m"][0] == pytest.approx(1.0 / softest)
    low, high = written["stiffness_range_n_m"]["pressures"]
    equal = [place["stiffness_n_m"][0] for place in written["ways"][-1]["places"]]
    assert (low, high) == pytest.approx((equal[0], equal[-1]))
    assert high > 1.5 * low
    assert written["stiffness_range_n_m"]["force.stiffness_factor"] == pytest.approx((0.5 * low, 2.0 * high))
    assert f"{0.5 * low:.3g} to {2.0 * high:.3g}" in result.output
    assert [mode["frequency_hz"] for mode in place["modes"]] == sorted(
        mode["frequency_hz"] for mode in place["modes"]
    )


@pytest.mark.parametrize("robot", ["asu_two_segment", "six_link", "planar.yaml"])
def test_reach_takes_hanging_buckled_and_planar_arms(soro, tmp_path, robot):
    link = {"length": 0.1, "radius": 0.01, "mass": 0.02, "strains": {"bending_x": {}}}
    link |= {"k_e": [300.0, 0.0, 0.0], "k_b": [0.04, 0.0, 0.0]}
    link["chambers"] = [{"angle_rad": 0.0, "alpha_eps": 0.0, "alpha_kappa": 1e-8}]
    planar = {"links": [link] * 2, "pressure_range_pa": [-50e3, 50e3]}
    (tmp_path / "planar.yaml").write_text(yaml.safe_dump(planar))
    result = soro("reach", robot, "--modes", "2", "--out", "a.png")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "a.png").stat().st_size > 10_000
    words = {"six_link": "free", "planar.yaml": "rigid"}
    assert words.get(robot, "") in result.output


def test_place_sensors_writes_picture_numbers_and_keys_of_a_scene(soro, tmp_path):
    result = soro(
        "place-sensors", "tue_three_bellow", "--count", "2", "--candidates", "2", "--json", "s.json"
    )
    assert result.exit_code == 0, result.output
    assert (tmp_path / "tue_three_bellow_sensors.png").stat().st_size > 10_000
    written = json.loads((tmp_path / "s.json").read_text())
    values = [step["information_nat"] for step in written["chosen"]]
    assert values[0] == 0.0 < values[1] < values[2] <= written["best"]["information_nat"] * (1.0 + 1e-12)
    block = result.output[result.output.index("twin:") : result.output.index("written:")]
    Scene.model_validate(yaml.safe_load(block))


@pytest.mark.slow
def test_a_noise_that_is_larger_makes_a_sensor_worth_less(soro, tmp_path):
    values = []
    for noise in ("0.0003", "0.01"):
        options = ("--kinds", "marker", "--count", "1", "--candidates", "1", "--noise", f"position_m={noise}")
        assert soro("place-sensors", "tue_three_bellow", *options, "--json", "s.json").exit_code == 0
        values.append(json.loads((tmp_path / "s.json").read_text())["chosen"][1]["information_nat"])
    assert values[1] < values[0]


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("reach", "tue_three_bellow", "--low", "nan"), "--low"),
        (("reach", "tue_three_bellow", "--high", "inf"), "--high"),
        (("reach", "tue_three_bellow", "--low", "95kPa"), "--low"),
        (("reach", "tue_three_bellow", "--out", "a.pdf"), "--out"),
        (("reach", "tue_three_bellow", "--json", "a.txt"), "--json"),
        (("reach", "silicone_rod"), "robot"),
        (("place-sensors", "silicone_rod"), "robot"),
        (("place-sensors", "tue_three_bellow", "--kinds", "pose,lidar"), "--kinds"),
        (("place-sensors", "tue_three_bellow", "--kinds", "pose,pose"), "--kinds"),
        (("place-sensors", "tue_three_bellow", "--count", "99"), "--count"),
        (("place-sensors", "tue_three_bellow", "--noise", "position_m=x"), "--noise"),
        (("place-sensors", "tue_three_bellow", "--noise", "position_m=-1"), "position_m"),
        (("place-sensors", "tue_three_bellow", "--noise", "length_m=1"), "length_m"),
        (("place-sensors", "tue_three_bellow", "--seconds", "1"), "--seconds"),
        (("place-sensors", "tue_three_bellow", "--set", "rate_hz=100"), "--set"),
        (("place-sensors", "tue_three_bellow", "--scene", "track_circle", "--seconds", "nan"), "--seconds"),
        (("place-sensors", "tue_three_bellow", "--out", "a.pdf"), "--out"),
        (("place-sensors", "tue_three_bellow", "--json", "a.txt"), "--json"),
    ],
)
def test_what_is_not_allowed_is_named(soro, tmp_path, arguments, key):
    result = soro(*arguments)
    assert isinstance(result.exception, ConfigError), result.output
    assert result.exception.key == key
    assert not list(tmp_path.iterdir())


def test_ctrl_c_ends_it_and_nothing_is_written(soro, tmp_path, monkeypatch):
    def stop(*of):
        raise KeyboardInterrupt

    monkeypatch.setattr("soro_lab.analysis.problem.windows", stop)
    assert soro("place-sensors", "tue_three_bellow").exit_code == 130
    assert not list(tmp_path.iterdir())
