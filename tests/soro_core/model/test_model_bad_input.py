"""Wrong arguments of the library make one line that names what is wrong, never an error of Python's own."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot, robot_from_dict, simulate
from soro_core.errors import ConfigError, ModelError, SoroError
from soro_core.integrate import make_stepper
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.pneumatics.chamber import ValveModel
from soro_core.robot import Discretisation, Robot
from tests.refused import fails, refused

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
    ("call", "where", "key", "names"),
    [
        (lambda: robot_from_dict(5), "robot", "", ("5", "dictionary")),
        (lambda: robot_from_dict(None), "robot", "", ("None", "dictionary")),
        (lambda: robot_from_dict([LINK]), "robot", "", ("dictionary",)),
        (lambda: robot_from_dict({1: 2}), "robot", "links", ()),
        (lambda: robot_from_dict({"links": LINK}), "robot", "links", ("{'length'",)),
        (lambda: robot_from_dict({"links": ["x"]}), "robot", "links[0]", ("'x'", "mapping")),
        (lambda: load_robot(None), "robots", "", ("None", ".yaml")),
        (lambda: load_robot(5), "robots", "", ("5", ".yaml")),
        (lambda: load_robot(b"x"), "robots", "", ("b'x'", ".yaml")),
        (lambda: load_robot("\0.yaml"), "\0.yaml", "", ("UTF-8",)),
        (lambda: load_robot("/"), "/", "", ("robots",)),
        (lambda: Robot(5), "Robot", "", ("5", "links, name")),
        (lambda: Robot(), "Robot", "links", ("'nothing'",)),
        (lambda: Robot(links=[]), "Robot", "links", ("[]",)),
        (lambda: ValveModel(fill=1e-9), "ValveModel", "fill", ("'an unknown key'", "fill_m3_s_pa, vent_m3")),
        (lambda: ValveModel(supply_pa="x"), "ValveModel", "supply_pa", ("'x'",)),
        (lambda: ValveModel(supply_pa=-1.0), "ValveModel", "supply_pa", ("-1.0",)),
        (lambda: ValveModel(band_pa=float("nan")), "ValveModel", "band_pa", ("nan",)),
        (lambda: ValveModel(1e-9), "ValveModel", "", ("1e-09", "fill_m3_s_pa")),
        (lambda: setattr(ValveModel(), "band_pa", 1.0), "ValveModel", "band_pa", ("1.0",)),
        (lambda: setattr(ROBOT, "tip_mass", 1.0), "Robot", "tip_mass", ("1.0",)),
        (lambda: Discretisation(nodes=1), "Discretisation", "", ("{'nodes': 1}", "nodes")),
        (lambda: ROBOT.replace(tip_mass="x"), "sample", "tip_mass", ("'x'",)),
        (lambda: ROBOT.refine("x"), "sample", "refine", ("'x'", "1")),
        (lambda: ROBOT.refine(True), "sample", "refine", ("True",)),
        (lambda: ROBOT.scaled(stiffness="x"), "sample", "scaled: stiffness", ("'x'",)),
    ],
)
def test_descriptions(call, where, key, names):
    with fails(ConfigError, *names, where=where, key=key):
        call()


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("? [1, 2]\n: 3\n", ""),
        ("day: 2020-13-45\n", "day"),  # a text, as in YAML 1.2, under a key that no robot has
        ("links: !!int x\n", "links"),
        ("a: " + "[" * 3000, ""),
    ],
)
def test_files_that_trip_the_reader(tmp_path, text, key):
    file = tmp_path / "wrong.yaml"
    file.write_text(text)
    with fails(ConfigError, where=str(file), key=key):
        load_robot(file)


@pytest.mark.parametrize(
    ("call", "key", "names"),
    [
        (lambda: SoftArm("x"), "robot", ("'x'", "load_robot", "robot_from_dict")),
        (lambda: SoftArm(None), "robot", ("None",)),
        (lambda: SoftArm(ROBOT, method=["exact"]), "method", ("['exact']", "exact", "mde")),
        (lambda: SoftArm(ROBOT, method=np.zeros(2)), "method", ("array([0., 0.])",)),
        (lambda: SoftArm(ROBOT, method="exact", steps=5), "steps", ("5", "'mde'")),
        (lambda: SoftArm(ROBOT, method="mde", nodes=5), "nodes", ("5", "'exact'")),
        (lambda: SoftArm(ROBOT, nodes=1), "nodes", ("1", "2")),
        (lambda: SoftArm(ROBOT, nodes=True), "nodes", ("True",)),
        (lambda: SoftArm(ROBOT, nodes=4.0), "nodes", ("4.0",)),
        (lambda: SoftArm(ROBOT, nodes="4"), "nodes", ("'4'",)),
        (
            lambda: SoftArm(ROBOT, nodes=10**9),
            "nodes",
            ("1000000000", "2"),
        ),
        (lambda: SoftArm(ROBOT, method="mde", steps=HUGE), "steps", ("100000", "1")),
    ],
)
def test_arms(call, key, names):
    with fails(ModelError, *names, key=key):
        call()


def test_whole_numbers_of_numpy_are_whole_numbers():
    assert SoftArm(ROBOT, nodes=np.int64(4)).nodes == 4
    assert type(SoftArm(ROBOT, nodes=np.uint8(4)).nodes) is int
    assert SoftArm(ROBOT, method="mde", steps=np.int32(3)).steps == 3
    assert ROBOT.refine(np.int64(2)).refinement == 2


@pytest.mark.parametrize(
    ("call", "key", "names"),
    [
        (lambda arm: arm.pose(Q, "tip"), "s", ("'tip'", "0", "0.1")),
        (lambda arm: arm.pose(Q, None), "s", ("None", "0")),
        (lambda arm: arm.pose(Q, [0.1]), "s", ("[0.1]", "0")),
        (lambda arm: arm.pose(Q, "0.1"), "s", ("'0.1'",)),
        (lambda arm: arm.pose(Q, 1j), "s", ("1j",)),
        (lambda arm: arm.pose(Q, HUGE), "s", ("100000", "0.1")),
        (lambda arm: arm.jacobian(Q, "tip"), "s", ("'tip'", "0")),
        (lambda arm: arm.jacobian(None, 0.1), "q", ("()", "(3,)")),
        (lambda arm: arm.inertia_matrix({}), "q", ("{}", "3")),
        (lambda arm: arm.inertia_matrix([[1, 2], [3]]), "q", ("[[1, 2], [3]]", "3")),
        (lambda arm: arm.inertia_matrix([HUGE, 0, 0]), "q", ("3",)),
        (lambda arm: arm.inertia_matrix(np.array(["a" * 40] * 20)), "q", ("3",)),
        (lambda arm: arm.coriolis_matrix(Q, "x"), "qd", ("'x'", "3")),
        (lambda arm: arm.gravity_force("x"), "q", ("'x'",)),
        (lambda arm: arm.elastic_force("x"), "q", ("'x'",)),
        (lambda arm: arm.damping_force(Q, "x"), "qd", ("'x'",)),
        (lambda arm: arm.actuation_matrix("x"), "q", ("'x'",)),
        (lambda arm: arm.energy(Q, "x"), "qd", ("'x'",)),
        (lambda arm: arm.inverse_dynamics(Q, Q, "x", Q), "v", ("'x'",)),
        (lambda arm: arm.inverse_dynamics(Q, Q, Q, [np.nan, 0, 0]), "a", ("[nan, 0.0, 0.0]",)),
        (lambda arm: arm.forward_dynamics(Q, Q, "x"), "p", ("'x'",)),
        (lambda arm: arm.forward_dynamics(Q, Q, Q, wrench="x"), "wrench", ("'x'", "6")),
        (lambda arm: arm.forward_dynamics(Q, Q, Q, internal=[1.0]), "internal", ("(1,)",)),
        (lambda arm: arm.external_forces(Q, Q, "x"), "wrench", ("'x'",)),
        (lambda arm: arm.internal_force(Q, "x"), "internal", ("'x'",)),
        (lambda arm: equilibrium(arm, "x"), "pressure", ("'x'", "3")),
        (lambda arm: equilibrium(arm, [0.0]), "pressure", ("(1,)",)),
        (lambda arm: equilibrium(arm, [np.inf, 0, 0]), "pressure", ("[inf",)),
        (lambda arm: equilibrium(arm, Q, start="x"), "start", ("'x'",)),
        (lambda arm: equilibrium("x", Q), "arm", ("'x'", "SoftArm")),
        (lambda arm: simulate("x"), "arm", ("'x'", "SoftArm")),
        (lambda arm: simulate(arm, "x"), "q0", ("'x'",)),
        (lambda arm: simulate(arm, Q, [1.0]), "qd0", ("(1,)",)),
        (lambda arm: simulate(arm, dt="x"), "dt", ("'x'", "0")),
        (lambda arm: simulate(arm, dt=True), "dt", ("True", "0")),
        (lambda arm: simulate(arm, dt=0), "dt", ("0",)),
        (lambda arm: simulate(arm, t_end=None), "t_end", ("None", "0")),
        (lambda arm: simulate(arm, t_end=HUGE), "t_end", ("100000",)),
        (lambda arm: simulate(arm, dt=1e-12), "dt", ("1e+12", "t_end")),
        (lambda arm: simulate(arm, dt=1.1e-8), "dt", ("t_end",)),  # 11 GB
        (lambda arm: simulate(arm, dt=5e-324), "dt", ("t_end",)),
        (lambda arm: simulate(arm, integrator=["rk4"]), "integrator", ("['rk4']", "trapezoidal")),
        (lambda arm: simulate(arm, integrator=None), "integrator", ("None", "trapezoidal")),
        (
            lambda arm: simulate(arm, integrator="dopri5", rtol="x"),
            "rtol",
            ("'x'", "1e-14"),
        ),
        (lambda arm: simulate(arm, integrator="dopri5", rtol=[1]), "rtol", ("[1]",)),
        (lambda arm: simulate(arm, pressure="x"), "pressure", ("'x'",)),
        (lambda arm: simulate(arm, pressure=[[1], [1, 2]]), "pressure", ("[[1], [1, 2]]",)),
        (
            lambda arm: simulate(arm, pressure=np.zeros((4, 3, 3))),
            "pressure",
            ("(4, 3, 3)", "(501,"),
        ),
        (lambda arm: simulate(arm, t_end=0.0, pressure=np.full((1, 3, 3), "x")), "pressure", ("array(",)),
        (lambda arm: simulate(arm, pressure=lambda t: "x"), "pressure(t)", ("'x'",)),
        (lambda arm: simulate(arm, wrench="x"), "wrench", ("'x'",)),
        (
            lambda arm: simulate(arm, valves={"band_pa": 1.0}),
            "valves",
            ("{'band_pa': 1.0}", "ValveModel"),
        ),
        (lambda arm: simulate(arm, internal0="x"), "internal0", ("'x'",)),
        (lambda arm: make_stepper("rk4", "x"), "arm", ("'x'", "SoftArm")),
        (lambda arm: make_stepper("rk4", arm).initial_state("x"), "q", ("'x'",)),
        (lambda arm: make_stepper("rk4", arm).step(None, Q, 1e-3), "state", ("None",)),
        (lambda arm: (s := make_stepper("rk4", arm)).step(s.initial_state(), Q, "x"), "dt", ("'x'",)),
    ],
)
def test_calls(arm, call, key, names):
    with fails(SoroError, *names, key=key):
        call(arm)


def test_a_long_state_is_told_on_one_line():
    """An array of more than ten numbers prints on several."""
    long = SoftArm(MANY)
    q = np.zeros(long.n_q)
    q[30] = -1.5
    calls = (lambda: long.gravity_force(q), lambda: long.forward_dynamics(q, q, np.zeros(36)))
    for call in calls:
        with fails(ModelError, "-1", key="elongation") as error:
            call()
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
    with refused("links[0].hysteresis", names=("stiffness 0", named)):
        robot_from_dict({"links": [{**plain, "strains": strains, "hysteresis": [element]}]})


def test_hysteresis_of_the_constant_strains_beside_varying_ones():
    strains = {"elongation": {}, "bending_x": {"basis": "legendre", "order": 1}, "bending_y": {}}
    element = {"stiffness": [1.0, 0.0, 0.0, 2.0], "range": [1.0] * 4}
    plain = {key: value for key, value in LINK.items() if key != "damping"}
    robot = robot_from_dict({"links": [{**plain, "strains": strains, "hysteresis": [element]}]})
    assert robot.n_q == 4
