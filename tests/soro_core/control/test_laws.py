"""Laws as parts: names, keys, what a law may not return, and laws that lose the arm."""

import re
from importlib.metadata import EntryPoint
from pathlib import Path

import control_samples
import numpy as np
import pytest
import yaml

from soro_core import load_robot, registered, robot_from_dict
from soro_core.config import find_config, load, parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.laws import Law
from tests.refused import refused

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs/adding_a_law.md").read_text(encoding="utf-8")
ROBOT = robot_from_dict({**control_samples.ROBOT, "links": [control_samples.LINK]})
DT = 0.005


def config(**keys):
    return parse(keys, ControllerConfig, "test")


@pytest.fixture
def entry(monkeypatch):
    """Installs laws of other packages by entry points."""
    found = []

    def entry_points(group, name=None):
        assert group == "soro.laws"
        return [one for one in found if name in (None, one.name)]

    monkeypatch.setattr(registered, "entry_points", entry_points)
    return lambda name, value: found.append(EntryPoint(name, value, "soro.laws"))


def tick(control):
    zero = np.zeros(control.arm.n_q)
    return control.step(control.initial_state(), zero, zero, 0.0, DT, np.zeros(control.arm.n_u))[1]


def test_the_example_of_the_page_runs(entry, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    assert len((ROOT / "examples/spring_law.py").read_text().splitlines()) <= 40
    name, value = re.search(r'^(\w+) = "(.*)"$', PAGE, re.M).groups()
    with refused("law", name, names=("adaptive", "computed_torque", "tip_pid")):
        config(law=name)
    entry(name, value)
    keys = yaml.safe_load(re.search(r"```yaml\n(.*?)```", PAGE, re.S).group(1))
    control = Controller(ROBOT, config(**keys))
    command = tick(control)
    assert command.status.ok
    assert command.estimates == {"run_s": DT}
    np.testing.assert_array_equal(command.desired_force, command.terms["model"] + command.terms["spring"])
    q_d = control.configured.sample(control.pressures.preview_s).q  # far from here: the arm is straight
    assert np.isfinite(q_d).all()
    with refused("law_options.stiffness", 2.0):
        config(law=name, law_options={"stiffness": 2.0})
    with refused("law_options.stifness", names=("stiffness",)):
        config(law=name, law_options={"stifness": 0.2})


def test_a_law_that_does_not_load_is_one_line_with_the_others(entry):
    entry("gone", "no_such_package:Law")
    with refused("law", "gone", names=("adaptive", "no_such_package")):
        config(law="gone")
    entry("number", "math:pi")
    with refused("law", "number", names=("adaptive", "math:pi")):
        config(law="number")


def test_shipped_files_are_of_a_law_and_its_keys_are_its_own():
    shipped = load(find_config("adaptive_three_bellow", "controllers"), ControllerConfig)
    assert (shipped.law, dict(shipped.law_options)) == ("adaptive", {})
    with refused("law_options.k_p", names=()):
        config(law="adaptive", law_options={"k_p": 1.0})
    with refused(""):
        config(law="tip_pid", compensation="measured")
    assert config(law="tip_pid", compensation="reference").law == "tip_pid"  # the default, written out


class Bad(Law):
    """Returns what it is given, and raises an error if that is one."""

    answer = None

    def __init__(self, setting, options):
        pass

    def initial_state(self):
        return 0

    def step(self, state, belief, reference, dt):
        if isinstance(self.answer, Exception):
            raise self.answer
        return state + 1, self.answer, {}


@pytest.mark.parametrize(
    "answer",
    [np.zeros(2), np.zeros((3, 1)), np.array([0.0, np.nan, 0.0]), None, IndexError("no such link")],
    ids=["two", "matrix", "not finite", "nothing", "error"],
)
def test_what_a_law_may_not_return_holds_the_set_points(entry, monkeypatch, answer):
    monkeypatch.setattr(Bad, "answer", np.array([0.5, 0.0, 0.0]))
    entry("bad", f"{__name__}:Bad")
    control = Controller(ROBOT, config(law="bad"))
    zero = np.zeros(3)
    state, good = control.step(control.initial_state(), zero, zero, 0.0, DT, zero)
    assert good.status.ok
    assert good.setpoint_pa.max() > 0.0
    monkeypatch.setattr(Bad, "answer", answer)
    after, held = control.step(state, zero, zero, DT, DT, zero)
    assert not held.status.ok
    assert "bad" in held.status.message
    assert after is state
    np.testing.assert_array_equal(held.setpoint_pa, good.setpoint_pa)


STANDING = load_robot(find_config("tue_three_bellow", "robots"))
HANGING = STANDING.replace(base_quaternion=(1.0, 0.0, 0.0, 0.0))
LOW = {"curvature_per_m": 7.0, "mean_pressure_pa": 40e3, "start_s": 2.0}


@pytest.mark.parametrize("law", ["tip_pid", "computed_torque"])
def test_a_law_that_loses_the_standing_arm_through_the_lag_is_refused(law):
    with refused("law", law, names=("composite", "20 g", "52 ms")):
        Controller(STANDING, config(law=law))


@pytest.mark.parametrize(
    "keys",
    [{"law": "tip_pid"}, {"law": "computed_torque", "law_options": {"load_kg": 0.0}}],
    ids=lambda keys: keys["law"],
)
def test_it_is_accepted_where_it_keeps_the_arm(keys):
    assert tick(Controller(HANGING, config(**keys, reference=LOW))).status.ok
