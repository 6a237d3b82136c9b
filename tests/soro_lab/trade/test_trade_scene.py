"""The section `model` of a scene: what it allows, and where it goes."""

from typing import get_args

import pytest
import yaml

from soro_core.errors import ConfigError
from soro_core.integrate import STEPPERS
from soro_core.robot import Discretisation, load_robot, robot_from_dict
from soro_core.robot.discretisation import Integrator
from soro_lab.scene import Requirement, check_model, load_scene
from soro_lab.trade import Candidate, with_chosen_model
from soro_lab.trade import slow_metrics as late
from soro_lab.trade.cache import Cache
from soro_lab.trade.choice import keep_choice
from tests.refused import fails, refused


@pytest.fixture
def scene(tmp_path):
    def make(**keys):
        path = tmp_path / "test.yaml"
        path.write_text(yaml.safe_dump({"robot": "tue_three_bellow", **keys}))
        return load_scene(path)

    return make


def test_without_a_model_nothing_changes(scene):
    plain = scene()
    twin = plain.twin_node()
    assert (twin.refine, twin.step_s, twin.integrator) == (4, 0.0025, "trapezoidal")
    parts = (twin.model, plain.estimator_node().model, plain.controller_node().model)
    assert parts == (Discretisation(),) * 3
    assert with_chosen_model(plain) is plain


def test_a_model_goes_to_all(scene):
    model = {"method": "mde", "steps": 7, "links": 2, "integrator": "rk4", "dt_s": 0.001}
    all_of_it = scene(model=model)
    wanted = Discretisation(method="mde", steps=7, links=2)
    assert all_of_it.estimator_node().model == all_of_it.controller_node().model == wanted
    twin = all_of_it.twin_node()
    assert (twin.model, twin.refine, twin.integrator, twin.step_s) == (wanted, 1, "rk4", 0.001)
    # A plant that the scene makes finer itself stays so.
    finer = scene(model=model, twin={"refine": 3}).twin_node()
    assert (finer.model, finer.refine) == (Discretisation(method="mde", steps=7), 3)
    own = scene(model=model, twin={"step_s": 0.004, "integrator": "midpoint"}).twin_node()
    assert (own.model, own.integrator, own.step_s) == (wanted, "midpoint", 0.004)


@pytest.mark.parametrize(
    ("keys", "found"),
    [
        ({"model": {"auto": True}}, ("model", "1%", "budget_us", "200", "rate_hz", "500")),
        ({"model": {"auto": True, "error": "1%", "nodes": 4}}, ("model", "no nodes", "auto: true")),
        ({"model": {"auto": True, "error": 1}}, ("model.error",)),
        ({"model": {"auto": True, "error": "1"}}, ("model.error", "1%")),
        ({"model": {"auto": True, "error": "nan%"}}, ("model.error", "1%")),
        ({"model": {"auto": True, "error": "1%", "rate_hz": 100}}, ("model", "one requirement")),
        ({"model": {"error": "1%"}}, ("model", "auto: true")),
        ({"model": "autos"}, ("model", "'autos'")),
        ({"model": {"method": "magic"}}, ("model.method", "'exact'")),
        ({"model": {"integrator": "magic"}}, ("model.integrator",)),
        ({"model": {"node": 3}}, ("model.node", "'an unknown key'")),
        ({"twin": {"model": {"links": 2}}}, ("twin", "no model")),
    ],
)
def test_mistakes_are_named(scene, keys, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        scene(**keys)


def test_the_names_of_the_steppers_are_those_that_exist():
    """Stated a second time, so that a scene is read without their kernels."""
    assert set(get_args(Integrator)) == set(STEPPERS)


@pytest.mark.parametrize(
    ("keys", "key", "got"),
    [
        (
            {"model": {"basis": "chebyshev", "order": 2}},
            "model",
            "basis chebyshev, order 2",
        ),
        ({"robot": "varying", "twin": {"refine": 2}}, "twin.refine", "refine 2"),
        ({"robot": "varying", "model": {"links": 2}}, "model", "links 2"),
        (
            {"robot": "varying", "model": {}, "twin": {"refine": 3}},
            "twin.refine",
            "refine 3",
        ),
    ],
)
def test_a_model_that_the_robot_cannot_have(scene, keys, key, got):
    """Losses of coefficients cannot be split, nor expanded in polynomials that are not orthogonal."""
    robot = load_robot("tue_three_bellow")
    if keys.get("robot") == "varying":
        strains = {"elongation": {}, "bending_x": {"basis": "legendre", "order": 1}, "bending_y": {}}
        link = robot.links[0].model_dump(exclude_unset=True, exclude={"creep", "hysteresis"})
        robot = robot_from_dict(
            {"links": [{**link, "strains": strains, "damping": [0.01, 1e-6, 1e-6, 1e-6]}]}
        )
    read = scene(**{key: value for key, value in keys.items() if key != "robot"})
    with fails(ConfigError, "links[0].damping", where="scene.yaml", key=key, got=got):
        check_model(read, robot, "scene.yaml")


def test_a_model_that_the_robot_can_have(scene):
    robot = load_robot("tue_three_bellow")
    for keys in ({}, {"model": {"basis": "legendre", "order": 12}}, {"twin": {"refine": 3}}):
        check_model(scene(**keys), robot, "scene.yaml")


def test_auto_takes_the_choice_or_says_what_to_run(scene, tmp_path):
    cache = Cache(tmp_path / "cache")
    auto = scene(model={"auto": True, "error": "2%"})
    with refused("model.auto"):
        auto.controller_node()
    with refused("model", names=("soro trade test --error 2%",)):
        with_chosen_model(auto, cache)
    candidate = Candidate(Discretisation(nodes=3, links=2), "rk4", 0.002)
    keep_choice(auto, Requirement(error="2%"), candidate, cache)
    chosen = with_chosen_model(auto, cache)
    assert chosen.controller_node().model == candidate.model
    assert chosen.twin_node().step_s == 0.002
    # Another requirement, or another run, is another choice; a name or a recorder is not.
    with refused("model", names=("soro trade test --error 1%",)):
        with_chosen_model(scene(model={"auto": True, "error": "1%"}), cache)
    with refused("model", names=("soro trade test --error 2%",)):
        with_chosen_model(scene(model={"auto": True, "error": "2%"}, twin={"payload_kg": 0.01}), cache)
    same = scene(model={"auto": True, "error": "2%"}, recorder={"enabled": False})
    assert with_chosen_model(same, cache).model == chosen.model


def test_auto_alone_requires_one_per_cent(scene):
    assert scene(model="auto").model.requirement == Requirement(error="1%")


def test_a_controller_that_cannot_take_a_model_says_why(scene, monkeypatch):
    """The closed loop gives a figure, or a reason in its place."""
    monkeypatch.setattr(late, "LOOP_LAST_S", 0.1)
    short = scene(rate_hz=50, controller={"reference": {"start_s": 0.1}}, twin={"pose": {"rate_hz": 50}})
    truth = Candidate(Discretisation(), "trapezoidal", 0.01)
    good = late.closed_loop(short, Discretisation(links=2), truth)
    assert 0.0 < good.tracking_mm < 30.0
    assert good.failure == ""
    six = scene(rate_hz=50, controller={"gains": {"k_p": [1.0, 1e-6]}}, twin={"pose": {"rate_hz": 50}})
    refused = late.closed_loop(six, Discretisation(), truth)
    assert refused.tracking_mm is None
    assert "gains.k_p" in refused.failure
    varying = late.closed_loop(short, Discretisation(basis="legendre", order=1), truth)
    assert (varying.tracking_mm is None) == bool(varying.failure)


def test_a_reference_of_explicit_steps_drives_a_twin_with_air_too(scene, monkeypatch):
    monkeypatch.setattr(late, "LOOP_LAST_S", 0.1)
    twin = {"pose": {"rate_hz": 50}, "air": "states"}
    short = scene(rate_hz=50, controller={"reference": {"start_s": 0.1}}, twin=twin)
    error = late.closed_loop(short, Discretisation(), Candidate(Discretisation(), "rk4", 0.01))
    assert error.failure == ""
    assert 0.0 < error.tracking_mm < 30.0
