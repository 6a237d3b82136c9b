"""Wrong arguments of the library make one line that names what is wrong, never an error of Python's own."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot, robot_from_dict, simulate
from soro_core.errors import ConfigError, ModelError, SoroError
from soro_core.integrate import make_stepper
from soro_core.model.statics import equilibrium
from soro_core.pneumatics.chamber import ValveModel
from soro_core.robot import Discretisation, Robot

LINK = {
    "length": 0.1,
    "radius": 0.02,
    "mass": 0.05,
    "k_e": [300.0, 100.0, 20.0],
    "k_b": [0.02, 0.01, 0.5],
    "damping": [0.1, 1e-6, 1e-6],
    "chambers": [{"angle_rad": 0.0, "area_m2": 1e-4, "offset_m": 0.01}] * 3,
}
ROBOT = robot_from_dict({"links": [LINK], "name": "sample"})
MANY = robot_from_dict({"links": [LINK] * 12, "name": "long"})
Q = np.zeros(3)
HUGE = 10**400


@pytest.fixture(scope="module")
def arm():
    return SoftArm(ROBOT)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: robot_from_dict(5), "robot: got 5; allowed: a dictionary with the keys of a robot file"),
        (lambda: robot_from_dict(None), "robot: got None; allowed: a dictionary"),
        (lambda: robot_from_dict([LINK]), "allowed: a dictionary"),
        (lambda: robot_from_dict({1: 2}), "robot: "),
        (lambda: robot_from_dict({"links": LINK}), "links: got {'length'"),
        (
            lambda: robot_from_dict({"links": ["x"]}),
            "links[0]: got 'x'; allowed: a mapping of keys to values",
        ),
        (lambda: load_robot(None), "robots: got None; allowed: a path ending in .yaml, or the name"),
        (lambda: load_robot(5), "robots: got 5; allowed: a path"),
        (lambda: load_robot(b"x"), "robots: got b'x'; allowed: a path"),
        (lambda: load_robot("\0.yaml"), "allowed: a readable UTF-8 file"),
        (lambda: load_robot("/"), "no robots file of that name"),
        (lambda: Robot(5), "Robot: got 5; allowed: values by name: links, name"),
        (lambda: Robot(), "Robot: links: got 'nothing'"),
        (lambda: Robot(links=[]), "Robot: links: got []"),
        (
            lambda: ValveModel(fill=1e-9),
            "ValveModel: fill: got 'an unknown key'; allowed: fill_m3_s_pa, vent_m3",
        ),
        (
            lambda: ValveModel(supply_pa="x"),
            "ValveModel: supply_pa: got 'x'; allowed: input should be a valid",
        ),
        (lambda: ValveModel(supply_pa=-1.0), "ValveModel: supply_pa: got -1.0"),
        (lambda: ValveModel(band_pa=float("nan")), "ValveModel: band_pa: got nan"),
        (lambda: ValveModel(1e-9), "ValveModel: got 1e-09; allowed: values by name: fill_m3_s_pa"),
        (lambda: setattr(ValveModel(), "band_pa", 1.0), "ValveModel: band_pa: got 1.0; allowed: no change"),
        (lambda: setattr(ROBOT, "tip_mass", 1.0), "Robot: tip_mass: got 1.0; allowed: no change"),
        (lambda: Discretisation(nodes=1), "Discretisation: got {'nodes': 1}; allowed: nodes: 0 or a number"),
        (lambda: ROBOT.replace(tip_mass="x"), "sample: tip_mass: got 'x'"),
        (lambda: ROBOT.refine("x"), "sample: refine: got 'x'; allowed: a whole number of 1 or more"),
        (lambda: ROBOT.refine(True), "sample: refine: got True"),
        (lambda: ROBOT.scaled(stiffness="x"), "sample: scaled: stiffness: got 'x'; allowed: a number"),
    ],
)
def test_descriptions(call, words):
    with pytest.raises(ConfigError) as error:
        call()
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("? [1, 2]\n: 3\n", "valid YAML"),
        ("day: 2020-13-45\n", "valid YAML"),
        ("length: !!int x\n", "valid YAML"),
        ("a: " + "[" * 3000, "valid YAML"),
    ],
)
def test_files_that_trip_the_reader(tmp_path, text, words):
    file = tmp_path / "wrong.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=words) as error:
        load_robot(file)
    assert str(error.value).startswith(f"{file}: got ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: SoftArm("x"), "robot: got 'x'; allowed: a Robot, from load_robot or robot_from_dict"),
        (lambda: SoftArm(None), "robot: got None"),
        (lambda: SoftArm(ROBOT, method=["exact"]), "method ['exact']: allowed are exact, mde"),
        (lambda: SoftArm(ROBOT, method=np.zeros(2)), "method array([0., 0.]): allowed are"),
        (lambda: SoftArm(ROBOT, method="exact", steps=5), "steps 5: allowed with method 'mde' only"),
        (lambda: SoftArm(ROBOT, method="mde", nodes=5), "nodes 5: allowed with method 'exact' only"),
        (lambda: SoftArm(ROBOT, nodes=1), "nodes 1: allowed is a whole number of 2 or more"),
        (lambda: SoftArm(ROBOT, nodes=True), "nodes True: allowed is a whole number"),
        (lambda: SoftArm(ROBOT, nodes=4.0), "nodes 4.0: allowed is a whole number"),
        (lambda: SoftArm(ROBOT, nodes="4"), "nodes '4': allowed is a whole number"),
        (
            lambda: SoftArm(ROBOT, nodes=10**9),
            "nodes 1000000000: allowed is a whole number of 2 or more, up to",
        ),
        (lambda: SoftArm(ROBOT, method="mde", steps=HUGE), "allowed is a whole number of 1 or more, up to"),
    ],
)
def test_arms(call, words):
    with pytest.raises(ModelError) as error:
        call()
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_whole_numbers_of_numpy_are_whole_numbers():
    assert SoftArm(ROBOT, nodes=np.int64(4)).nodes == 4
    assert type(SoftArm(ROBOT, nodes=np.uint8(4)).nodes) is int
    assert SoftArm(ROBOT, method="mde", steps=np.int32(3)).steps == 3
    assert ROBOT.refine(np.int64(2)).refinement == 2


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda arm: arm.pose(Q, "tip"), "s = 'tip' m: allowed is 0 to 0.1 m"),
        (lambda arm: arm.pose(Q, None), "s = None m: allowed is 0 to"),
        (lambda arm: arm.pose(Q, [0.1]), "s = [0.1] m: allowed is 0 to"),
        (lambda arm: arm.pose(Q, "0.1"), "s = '0.1' m"),
        (lambda arm: arm.pose(Q, 1j), "s = 1j m"),
        (lambda arm: arm.pose(Q, HUGE), "allowed is 0 to"),
        (lambda arm: arm.jacobian(Q, "tip"), "s = 'tip' m: allowed is 0 to"),
        (lambda arm: arm.jacobian(None, 0.1), "q has shape (), allowed is (3,)"),
        (lambda arm: arm.inertia_matrix({}), "q: got {}, allowed are 3 numbers for sample"),
        (lambda arm: arm.inertia_matrix([[1, 2], [3]]), "q: got [[1, 2], [3]], allowed are 3 numbers"),
        (lambda arm: arm.inertia_matrix([HUGE, 0, 0]), "allowed are 3 numbers"),
        (lambda arm: arm.inertia_matrix(np.array(["a" * 40] * 20)), "allowed are 3 numbers"),
        (lambda arm: arm.coriolis_matrix(Q, "x"), "qd: got 'x', allowed are 3 numbers"),
        (lambda arm: arm.gravity_force("x"), "q: got 'x'"),
        (lambda arm: arm.elastic_force("x"), "q: got 'x'"),
        (lambda arm: arm.damping_force(Q, "x"), "qd: got 'x'"),
        (lambda arm: arm.actuation_matrix("x"), "q: got 'x'"),
        (lambda arm: arm.energy(Q, "x"), "qd: got 'x'"),
        (lambda arm: arm.inverse_dynamics(Q, Q, "x", Q), "v: got 'x'"),
        (lambda arm: arm.inverse_dynamics(Q, Q, Q, [np.nan, 0, 0]), "a is not finite: [nan, 0.0, 0.0]"),
        (lambda arm: arm.forward_dynamics(Q, Q, "x"), "p: got 'x'"),
        (lambda arm: arm.forward_dynamics(Q, Q, Q, wrench="x"), "wrench: got 'x', allowed are 6 numbers"),
        (lambda arm: arm.forward_dynamics(Q, Q, Q, internal=[1.0]), "internal has shape (1,)"),
        (lambda arm: arm.external_forces(Q, Q, "x"), "wrench: got 'x'"),
        (lambda arm: arm.internal_force(Q, "x"), "internal: got 'x'"),
        (lambda arm: equilibrium(arm, "x"), "pressure: got 'x', allowed are 3 numbers"),
        (lambda arm: equilibrium(arm, [0.0]), "pressure has shape (1,)"),
        (lambda arm: equilibrium(arm, [np.inf, 0, 0]), "pressure is not finite"),
        (lambda arm: equilibrium(arm, Q, start="x"), "start: got 'x'"),
        (lambda arm: equilibrium("x", Q), "arm: got 'x'; allowed: a SoftArm"),
        (lambda arm: simulate("x"), "arm: got 'x'; allowed: a SoftArm"),
        (lambda arm: simulate(arm, "x"), "q0: got 'x'"),
        (lambda arm: simulate(arm, Q, [1.0]), "qd0 has shape (1,)"),
        (lambda arm: simulate(arm, dt="x"), "dt = 'x' s: allowed is a number above 0"),
        (lambda arm: simulate(arm, dt=True), "dt = True s: allowed is a number above 0"),
        (lambda arm: simulate(arm, dt=0), "dt = 0 s: allowed is a number above 0"),
        (lambda arm: simulate(arm, t_end=None), "t_end = None s: allowed is a number of 0 or more"),
        (lambda arm: simulate(arm, t_end=HUGE), "allowed is a number of 0 or more"),
        (lambda arm: simulate(arm, dt=1e-12), "are 1e+12 steps: allowed are"),
        (lambda arm: simulate(arm, dt=1.1e-8), "steps: allowed are"),  # 11 GB
        (lambda arm: simulate(arm, dt=5e-324), "steps: allowed are"),
        (lambda arm: simulate(arm, integrator=["rk4"]), "integrator ['rk4']: allowed are trapezoidal"),
        (lambda arm: simulate(arm, integrator=None), "integrator None: allowed are trapezoidal"),
        (
            lambda arm: simulate(arm, integrator="dopri5", rtol="x"),
            "rtol = 'x': allowed is a number from 1e-14",
        ),
        (lambda arm: simulate(arm, integrator="dopri5", rtol=[1]), "rtol = [1]: allowed is a number"),
        (lambda arm: simulate(arm, pressure="x"), "pressure: got 'x'"),
        (lambda arm: simulate(arm, pressure=[[1], [1, 2]]), "pressure: got [[1], [1, 2]]"),
        (
            lambda arm: simulate(arm, pressure=np.zeros((4, 3, 3))),
            "pressure has shape (4, 3, 3), allowed is (501,",
        ),
        (lambda arm: simulate(arm, t_end=0.0, pressure=np.full((1, 3, 3), "x")), "pressure: got array("),
        (lambda arm: simulate(arm, pressure=lambda t: "x"), "pressure(t): got 'x'"),
        (lambda arm: simulate(arm, wrench="x"), "wrench: got 'x'"),
        (
            lambda arm: simulate(arm, valves={"band_pa": 1.0}),
            "valves: got {'band_pa': 1.0}; allowed: a ValveModel",
        ),
        (lambda arm: simulate(arm, internal0="x"), "internal0: got 'x'"),
        (lambda arm: make_stepper("rk4", "x"), "arm: got 'x'; allowed: a SoftArm"),
        (lambda arm: make_stepper("rk4", arm).initial_state("x"), "q: got 'x'"),
        (lambda arm: make_stepper("rk4", arm).step(None, Q, 1e-3), "state: got None; allowed: a State"),
        (lambda arm: (s := make_stepper("rk4", arm)).step(s.initial_state(), Q, "x"), "dt = 'x' s: allowed"),
    ],
)
def test_calls(arm, call, words):
    with pytest.raises(SoroError) as error:
        call(arm)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_a_long_state_is_told_on_one_line():
    """An array of more than ten numbers prints on several."""
    long = SoftArm(MANY)
    q = np.zeros(long.n_q)
    q[30] = -1.5
    calls = (lambda: long.gravity_force(q), lambda: long.forward_dynamics(q, q, np.zeros(36)))
    for call in calls:
        with pytest.raises(ModelError, match="elongation is -1 or less") as error:
            call()
        assert "\n" not in str(error.value)
        assert len(str(error.value)) < 300


def test_numbers_of_other_kinds_are_numbers(arm):
    whole = arm.pose(Q, 0)
    np.testing.assert_array_equal(arm.pose(Q, np.float32(0.0)), whole)
    np.testing.assert_array_equal(arm.pose(Q, np.array(0.0)), whole)
    result = simulate(arm, t_end=np.int64(0), dt=np.float32(1e-3))
    assert result.status.ok
    assert len(result.t) == 1


@pytest.mark.parametrize(
    ("strains", "stiffness", "named"),
    [
        ({"bending_x": {"basis": "legendre", "order": 1}}, [1.0, 0.0], "bending_x"),
        ({"bending_x": {"basis": "legendre", "order": 1}}, [0.0, 1.0], "bending_x"),
        ({"elongation": {}, "bending_y": {"basis": "chebyshev", "order": 1}}, [1.0, 0.0, 1.0], "bending_y"),
        ({"bending_x": {"basis": "pod", "samples": [[1.0], [1.0], [2.0], [3.0]]}}, [1.0], "bending_x"),
    ],
)
def test_hysteresis_acts_on_constant_strain_only(strains, stiffness, named):
    element = {"stiffness": stiffness, "range": [1.0] * len(stiffness)}
    plain = {key: value for key, value in LINK.items() if key != "damping"}
    with pytest.raises(ConfigError) as error:
        robot_from_dict({"links": [{**plain, "strains": strains, "hysteresis": [element]}]})
    line = str(error.value)
    assert line.startswith("robot: links[0].hysteresis: got ")
    assert line.endswith(f"allowed: stiffness 0 for {named}: hysteresis acts on constant strain only")


def test_hysteresis_of_the_constant_strains_beside_varying_ones():
    strains = {"elongation": {}, "bending_x": {"basis": "legendre", "order": 1}, "bending_y": {}}
    element = {"stiffness": [1.0, 0.0, 0.0, 2.0], "range": [1.0] * 4}
    plain = {key: value for key, value in LINK.items() if key != "damping"}
    robot = robot_from_dict({"links": [{**plain, "strains": strains, "hysteresis": [element]}]})
    assert robot.n_q == 4
