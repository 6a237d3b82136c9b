"""Laws as parts: names, keys, what a law may not return, and laws that lose the arm."""

import copy
import pickle
import re
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import control_samples
import numpy as np
import pytest
import yaml

from soro_core import load_robot, registered, robot_from_dict
from soro_core.adaptation.kept import keep
from soro_core.config import find_config, load, parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.laws import Law, LawOptions
from soro_core.control.laws.registry import find_law
from soro_lab.scene import check_learned, load_scene
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
    keys = yaml.safe_load(re.search(r"```yaml\n(.*?)```", PAGE, re.S).group(1))["controller"]
    control = Controller(ROBOT, config(**keys | {"law": name}))
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


FILE = """
from soro_core.control.laws import Law

class Mine(Law):
    def initial_state(self):
        return 0

    def step(self, state, belief, reference, dt):
        q = reference.ahead.q
        return state + 1, self.setting.arm.gravity_force(q) + self.setting.arm.elastic_force(q), {}
"""


def written(folder, text):
    (folder / "my_law.py").write_text(text, encoding="utf-8")
    return f"{folder / 'my_law.py'}:Mine"


def test_a_law_of_a_file_needs_neither_package_nor_init(tmp_path, monkeypatch):
    place = written(tmp_path, FILE)
    control = Controller(ROBOT, config(law=place))
    assert tick(control).status.ok
    assert copy.copy(control.law).setting is control.law.setting
    rest = np.zeros(3)
    assert control.law.reference_force(0, rest, rest, rest) == pytest.approx(control.arm.gravity_force(rest))
    monkeypatch.chdir(tmp_path)
    assert config(law="my_law.py:Mine").law == place  # from the working folder, and stated as a whole path
    written(tmp_path, FILE.replace("Mine", "Other"))
    with refused("law", place, names=("adaptive", "FILE.py:CLASS", "Mine")):
        config(law=place)


class Still(Law):
    """A law that asks for one force."""

    class Options(LawOptions):
        force: float = 0.0

    def __init__(self, setting, options):
        self.force = options.force

    def initial_state(self):
        return None

    def step(self, state, belief, reference, dt):
        return state, np.full(len(belief.q), self.force), {}


def test_a_program_gives_the_class_of_its_law():
    control = Controller(ROBOT, ControllerConfig(law=Still, law_options={"force": 0.2}))
    assert type(control.law) is Still
    assert tick(control).desired_force == pytest.approx(0.2)
    assert ControllerConfig(law=control.config.law) == ControllerConfig(law=Still)
    with refused("law_options.force", "much"):
        ControllerConfig(law=Still, law_options={"force": "much"})


@pytest.mark.parametrize("law", [int, Law, object()])
def test_a_class_that_is_no_law_is_refused(law):
    with refused("law"):
        ControllerConfig(law=law)


def test_a_scene_finds_the_file_of_its_law_beside_itself(tmp_path, monkeypatch):
    beside, elsewhere = tmp_path / "scenes", tmp_path / "elsewhere"
    beside.mkdir(), elsewhere.mkdir()
    place = written(beside, FILE)
    (beside / "mine.yaml").write_text("robot: tue_three_bellow\ncontroller: {law: my_law.py:Mine}\n")
    (beside / "far.yaml").write_text("robot: tue_three_bellow\ncontroller: gains.yaml\n")
    (beside / "gains.yaml").write_text("law: my_law.py:Mine\n")
    monkeypatch.chdir(elsewhere)
    assert load_scene(beside / "mine.yaml").controller.law == place
    assert load_scene(beside / "far.yaml").controller.law == place
    with refused("controller.law", "my_law.py:Mine", names=("adaptive", "no file")):
        load_scene("track_circle", {"controller.law": "my_law.py:Mine"})
    of_folder = written(elsewhere, FILE)
    assert load_scene("track_circle", {"controller.law": "my_law.py:Mine"}).controller.law == of_folder


LEARNS = """
from soro_core.control.laws.composite import Composite, CompositeOptions

class Options(CompositeOptions):
    own: float = 0.0

class Mine(Composite):
    Options = Options
"""


def test_learned_numbers_of_a_law_with_keys_of_its_own_are_checked(tmp_path):
    changes = {"controller.law": written(tmp_path, LEARNS), "controller.law_options": {"own": 1.0}}
    scene = load_scene("track_circle", changes)
    model = scene.discretisation.discretise(scene.loaded_robot)
    with refused("numbers.link0/area_slope", "none"):
        check_learned(scene.with_learned(keep(model, {"no_such": 0.0}, {"no_such": 0.01})), "kept")


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (None, ("no file",)),
        ("class Mine(:\n", ("SyntaxError", "my_law.py, line 1")),
        ("a = 1\nb = a / 0\n", ("ZeroDivisionError", "my_law.py, line 2")),
        ("import sys\nsys.exit(0)\n", ("SystemExit", "my_law.py, line 2")),
        ("Mine = 3\n", ("subclass of soro_core.control.laws.Law",)),
        (FILE.replace("def step", "def stop"), ("subclass of soro_core.control.laws.Law",)),
        (FILE + "\n    Options = dict\n", ("LawOptions",)),
    ],
    ids=["no file", "syntax", "error", "exit", "number", "no step", "options"],
)
def test_a_file_that_is_no_law_is_one_line(tmp_path, text, names):
    before = set(sys.modules)
    place = str(tmp_path / "my_law.py:Mine") if text is None else written(tmp_path, text)
    with refused("law", place, names=("adaptive", *names)):
        config(law=place)
    if "line" in names[-1]:
        assert not [name for name in set(sys.modules) - before if "law" in name]


def test_a_state_of_the_class_of_a_file_can_be_pickled(tmp_path):
    text = "from typing import NamedTuple\n\nclass Seen(NamedTuple):\n    ticks: int\n"
    law = find_law(written(tmp_path, text + FILE.replace("return 0", "return Seen(0)")))
    assert pickle.loads(pickle.dumps(law.initial_state(None))) == (0,)


@pytest.mark.parametrize(
    "method",
    [
        "def __init__(self, setting, options):\n        {}",
        "def initial_state(self):\n        {}",
        "def step(self, state, belief, reference, dt):\n        {}",
        "def reference_force(self, state, q, qd, qdd):\n        {}",
        "def place(self, belief, reference):\n        {}",
        "def actuation(self, state, actuation, q):\n        {}",
        "def allocated(self, state, made, dt):\n        {}",
        "def estimates(self, state):\n        {}",
        "def counts(self, state):\n        {}",
    ],
    ids=lambda text: text.split("(")[0].removeprefix("def "),
)
@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("self.no_such_name", "AttributeError: 'Mine' object has no attribute 'no_such_name'"),
        ("self.setting.arm.gravity_force([1.0])", "ModelError: "),
    ],
    ids=["python", "model"],
)
def test_a_law_that_fails_at_rest_is_refused_with_its_line(tmp_path, method, line, found):
    text = f"{FILE}\n    {method.format(line)}\n"
    place = written(tmp_path, text)
    number = 1 + text.splitlines().index(f"        {line}")
    with refused("law", place, names=(found, f"(my_law.py, line {number})")):
        Controller(ROBOT, config(law=place))


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        (", {}\n", " * float('nan'), {}\n", "force is not finite"),
        (", {}\n", " + 1e308, {}\n", "no finite pressures"),
        (", {}\n", ", None\n", "NoneType"),
        (", {}\n", ", [q]\n", "list"),
        (", {}\n", ", {'a': 'text'}\n", "'a'"),
        (", {}\n", ", {'a': q[:1]}\n", "'a'"),
        (", {}\n", ", {'a': q * float('nan')}\n", "'a'"),
        (", {}\n", ", {}\n    def estimates(self, state): return {'a': 'text'}\n", "'text'"),
        (", {}\n", ", {}\n    def estimates(self, state): return 'text'\n", "str"),
        (", {}\n", ", {}\n    def estimates(self, state): return {'a': 'b' if state else 0.0}\n", "'b'"),
        (", {}\n", ", {}\n    def note(self, state): return 3\n", "note"),
        (", {}\n", ", {}\n    def actuation(self, state, H, q): return 'text'\n", "Error"),
    ],
)
def test_what_a_law_may_not_return_at_rest_is_refused(tmp_path, old, new, found):
    place = written(tmp_path, FILE.replace(old, new))
    with refused("law", place, names=(found,)):
        Controller(ROBOT, config(law=place))


def test_a_law_that_does_not_load_is_one_line_with_the_others(entry):
    entry("gone", "no_such_package:Law")
    with refused("law", "gone", names=("adaptive", "no_such_package")):
        config(law="gone")
    entry("number", "math:pi")
    with refused("law", "number", names=("adaptive", "math:pi")):
        config(law="number")


PACKAGE = {
    "__init__.py": "from NAME.law import Mine\n",
    "law.py": "from NAME.helper import force\n"
    + FILE.replace("gravity_force(q) +", "gravity_force(q) + force(q) +"),
    "helper.py": "def force(q):\n    return q[7]\n",
}


@pytest.fixture
def package(entry, monkeypatch, tmp_path):
    """Writes a package of three files with a law, named by an entry point."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(name, **files):
        (tmp_path / name).mkdir()
        for file, text in (PACKAGE | {f"{file}.py": text for file, text in files.items()}).items():
            (tmp_path / name / file).write_text(text.replace("NAME", name))
        entry(name, f"{name}:Mine")
        return name

    return write


def test_an_error_in_a_law_of_a_package_names_law_file_and_line(package):
    with refused("law", package("helped_law"), names=("IndexError", "(helper.py, line 2)")):
        Controller(ROBOT, config(law="helped_law"))


@pytest.mark.parametrize(
    ("helper", "names"),
    [
        ("import no_such_package\n", ("no_such_package", "(helper.py, line 1)")),
        ("import sys\nsys.exit(3)\n", ("SystemExit: 3", "(helper.py, line 2)")),
    ],
)
def test_a_package_that_does_not_load_is_named_with_file_and_line(package, helper, names):
    name = package(f"law_that_has_{'exited' if 'exit' in helper else 'no_package'}", helper=helper)
    with refused("law", name, names=("adaptive", *names)):
        config(law=name)


def test_shipped_files_are_of_a_law_and_its_keys_are_its_own():
    shipped = load(find_config("adaptive_three_bellow", "controllers"), ControllerConfig)
    assert (shipped.law, dict(shipped.law_options)) == ("adaptive", {})
    with refused("law_options.k_p", names=()):
        config(law="adaptive", law_options={"k_p": 1.0})
    with refused(""):
        config(law="tip_pid", compensation="measured")
    with refused("", names=("law: adaptive, which is to be stated",)):
        config(compensation="measured")  # no law is stated: it does not choose one
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


RAISED = 1 + Path(__file__).read_text(encoding="utf-8").splitlines().index("            raise self.answer")


@pytest.mark.parametrize(
    "answer",
    [
        np.zeros(2),
        np.zeros((3, 1)),
        np.array([0.0, np.nan, 0.0]),
        None,
        IndexError("no such link"),
        np.linalg.LinAlgError("singular"),
    ],
    ids=["two", "matrix", "not finite", "nothing", "error", "singular"],
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
    if isinstance(answer, Exception):
        assert str(answer) in held.status.message
        assert f"(test_laws.py, line {RAISED})" in held.status.message
    assert after is state
    np.testing.assert_array_equal(held.setpoint_pa, good.setpoint_pa)


STANDING = load_robot(find_config("tue_three_bellow", "robots"))
HANGING = STANDING.replace(base_quaternion=(1.0, 0.0, 0.0, 0.0))
LOW = {"curvature_per_m": 7.0, "mean_pressure_pa": 40e3, "start_s": 2.0}


@pytest.mark.slow
@pytest.mark.parametrize("law", ["tip_pid", "computed_torque"])
def test_a_law_that_loses_the_standing_arm_through_the_lag_is_refused(law):
    with refused("law", law, names=("composite", "20 g", "52 ms")):
        Controller(STANDING, config(law=law))


@pytest.mark.slow
@pytest.mark.parametrize(
    "keys",
    [{"law": "tip_pid"}, {"law": "computed_torque", "law_options": {"load_kg": 0.0}}],
    ids=lambda keys: keys["law"],
)
def test_it_is_accepted_where_it_keeps_the_arm(keys):
    assert tick(Controller(HANGING, config(**keys, reference=LOW))).status.ok
