"""What the file of a study says: draws, grids and factors; and what its rows say."""

import numpy as np
import pytest

from soro_core.config import parse
from soro_core.errors import ConfigError
from soro_ros.study.summary import bootstrapped, share
from soro_ros.study.variations import StudyFile


def file(samples, **vary):
    return parse({"samples": samples, "vary": vary}, StudyFile, "file")


def column(found, key):
    return np.array([found.values(run)[key] for run in range(found.runs)])


def test_draws_follow_their_distributions():
    found = file(
        4000,
        a={"uniform": [2.0, 4.0]},
        b={"normal": [1.0, 0.5]},
        c={"lognormal": [3.0, 0.2]},
        d={"integers": [1, 3]},
        e={"choice": [1.0, 10.0]},
    )
    a, b, c, d, e = (column(found, key) for key in "abcde")
    assert (a.min() >= 2.0, a.max() <= 4.0, a.mean()) == (True, True, pytest.approx(3.0, abs=0.05))
    assert (b.mean(), b.std()) == (pytest.approx(1.0, abs=0.03), pytest.approx(0.5, abs=0.03))
    assert (np.median(c), np.log(c).std()) == (pytest.approx(3.0, abs=0.05), pytest.approx(0.2, abs=0.02))
    assert set(d) == {1, 2, 3}
    assert np.mean(e == 10.0) == pytest.approx(0.5, abs=0.05)


def test_another_key_and_more_samples_do_not_change_draws():
    few, many = file(5, a={"normal": [0, 1]}), file(9, b={"uniform": [0, 1]}, a={"normal": [0, 1]})
    np.testing.assert_array_equal(column(few, "a"), column(many, "a")[:5])


def test_each_combination_of_grids_meets_the_same_draws():
    found = file(2, a={"grid": [1, 2, 3]}, b={"grid": ["x", "y"]}, c={"uniform": [0, 1]})
    assert found.runs == 12
    rows = [found.values(run) for run in range(12)]
    assert len({(row["a"], row["b"], row["c"]) for row in rows}) == 12
    assert len({row["c"] for row in rows[:6]}) == 1
    assert list(rows[0]) == ["a", "b", "c"]


def test_a_scale_multiplies_what_is_there():
    found = file(1, a={"scale": [2.0, 2.0]}, b={"scale": {"grid": [0.5, 3.0]}})
    assert found.runs == 2
    assert found.scaled("a", found.values(0)["a"], 4.0) == 8.0
    assert found.scaled("b", found.values(1)["b"], (1.0, 2.0)) == [3.0, 6.0]


def test_intervals_hold_what_they_should():
    """Of 200 samples of 40 draws about 95 % of the intervals of the mean hold the true one."""
    rng = np.random.default_rng(5)
    held = [bootstrapped(rng.normal(1.0, 2.0, 40), np.mean) for _ in range(200)]
    assert 0.88 <= np.mean([one.low <= 1.0 <= one.high for one in held]) <= 0.98
    half = share(50, 100)
    assert (half.value, half.low, half.high) == (
        0.5,
        pytest.approx(0.404, abs=1e-3),
        pytest.approx(0.596, abs=1e-3),
    )
    assert bootstrapped(np.ones(5), np.median).low == 1.0
    assert np.isnan(bootstrapped(np.ones(2), np.median).low)


def test_values_may_have_the_units_of_their_keys():
    found = file(
        3,
        **{
            "twin.payload_kg": {"uniform": ["0g", "10g"]},
            "robot.links[0].length": {"choice": ["60mm", "60mm"]},
            "controller.limits.rise_pa": {"grid": ["1kPa", 2.0]},
            "wait_us": {"integers": ["1ms", "2ms"]},
            "robot.links[0].mass": {"lognormal": ["10 g", 0.0]},
            "robot": {"choice": ["3m.yaml"]},
        },
    )
    row = found.values(0)
    assert 0.0 <= row["twin.payload_kg"] <= 0.01
    assert row["robot.links[0].length"] == 0.06
    assert [found.values(k)["controller.limits.rise_pa"] for k in (0, 1)] == [1e3, 2.0]
    assert 1000 <= row["wait_us"] <= 2000
    assert row["robot.links[0].mass"] == pytest.approx(0.01)
    assert row["robot"] == "3m.yaml"
    with pytest.raises(ConfigError, match=r"twin\.payload_kg: a mass in kg, g, mg"):
        file(1, **{"twin.payload_kg": {"uniform": ["0s", "1s"]}})
