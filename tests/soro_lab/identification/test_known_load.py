"""A known weight fixes the common scale of gains and stiffness, which pressures and poses leave open."""

from dataclasses import replace

import numpy as np
import pytest
from made_arm import levels, record
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from soro_core import SoftArm, load_robot
from soro_core.errors import ConfigError
from soro_core.model.equilibrium.statics import equilibrium
from soro_lab.commands import identify as command
from soro_lab.identification.arm.cases.case import Rests, Whole
from soro_lab.identification.arm.cases.parameters import numbers_of, with_numbers
from soro_lab.identification.arm.frames import frame_numbers
from soro_lab.identification.arm.laws import free_parameters, plain
from soro_lab.identification.arm.robot_yaml import robot_text
from soro_lab.identification.arm.search.prepare import rests_of
from soro_lab.identification.arm.search.problem import Problem
from soro_lab.identification.arm.search.solve import solve
from soro_lab.identification.arm.search.uncertainty import certainty, scale_deviation
from soro_lab.identification.arm.stages import IdentificationOptions, identify
from soro_lab.identification.recording import Place, Plate
from tests.refused import refused

LOAD = 0.02
PUSH_N = (-0.08, 0.0, 0.0)
GUESS = plain(load_robot("tue_three_bellow"))


def scaled(scale):
    """The arm with gains and stiffness of another scale."""
    stiffness = {f"link0/{key}": scale * numbers_of(GUESS)[f"link0/{key}"].value for key in ("k_e", "k_b")}
    return with_numbers(GUESS, {"link0/gain": scale, **stiffness})


def held_in_the_world(arm, push_n):
    return lambda q: np.append(np.zeros(3), arm.pose(q, arm.length)[:3, :3].T @ push_n)


def rests(robot, loads, pushes=None):
    """What a tracker sees of the arm at levels of its pressures, without and with weights or pushes."""
    draw, arm = np.random.default_rng(1), SoftArm(robot)
    p, pushes = np.array(levels(robot.n_u, 50e3))[::2], pushes or [(0.0, 0.0, 0.0)] * len(loads)
    both = [(load, push, row) for load, push in zip(loads, pushes, strict=True) for row in p]
    q = np.array([equilibrium(arm, row, None, m, wrench=held_in_the_world(arm, f)) for m, f, row in both])
    poses = arm.poses(q, arm.length)
    n = len(poses)
    noise = Rotation.from_rotvec(draw.normal(0.0, 2e-3, (n, 3)))
    turns = (Rotation.from_matrix(poses[:, :3, :3]) * noise).as_quat()
    position = poses[:, :3, 3] + draw.normal(0.0, 1e-4, (n, 3))
    shape = Plate("tip", np.arange(n, dtype=float), Place(0), position, turns)
    stated = tuple(np.repeat(loads, len(p)).tolist()), tuple(push for _, push, _ in both)
    return Rests("rests", np.tile(p, (len(loads), 1)), (shape,), *stated)


def fitted(case):
    """Values, and deviation of the scale, of a fit of states at rest."""
    own = tuple(n for n in free_parameters(GUESS, (), "eb", ())[0] if "damping" not in n.name)
    numbers = (*own, *frame_numbers(SoftArm(GUESS), [case]))
    problem = Problem(GUESS, (case,), numbers, {"tip": np.array([5e-4] * 3 + [5e-3] * 3)}, is_constant=True)
    found = solve(problem, {}, 30)
    return found.values, scale_deviation(numbers, certainty(problem, found))


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_one_known_weight_fixes_the_scale(scale):
    values, deviation = fitted(rests(scaled(scale), [0.0, LOAD]))
    assert deviation < 0.01
    assert values["link0/gain"] * values["link0/arm"] == pytest.approx(scale, rel=0.01)
    assert values["link0/k_b"] == pytest.approx(scale * numbers_of(GUESS)["link0/k_b"].value, rel=0.01)
    assert values["link0/gain"] == pytest.approx(scale, rel=0.04)


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_one_push_on_a_scale_fixes_it_too(scale, figure):
    values, deviation = fitted(rests(scaled(scale), [0.0, 0.0], [(0.0, 0.0, 0.0), PUSH_N]))
    found = values["link0/gain"] * values["link0/arm"] / scale
    figure(f"gain after one known push: {100 * (found - 1):+.2f} %, deviation {100 * deviation:.2f} %")
    assert deviation < 0.015
    assert found == pytest.approx(1.0, rel=0.03)


def test_without_it_the_deviation_says_that_the_scale_is_open():
    _, deviation = fitted(rests(scaled(0.9), [0.0]))
    assert deviation > 0.04


def test_a_run_is_simulated_with_its_weight():
    heavy = GUESS.replace(tip_mass=GUESS.tip_mass + LOAD)
    made = record(heavy, hold_s=0.2)
    arm = SoftArm(GUESS)
    with_load = Whole(replace(made, load_kg=LOAD), dt=0.005).simulated(arm, {})
    np.testing.assert_array_equal(with_load.q, Whole(made, dt=0.005).simulated(SoftArm(heavy), {}).q)
    assert np.abs(with_load.q - Whole(made, dt=0.005).simulated(arm, {}).q).max() > 1e-2


def test_a_run_is_simulated_with_its_push():
    made = record(GUESS, hold_s=0.2)
    arm, case = SoftArm(GUESS), Whole(replace(made, push_n=PUSH_N), dt=0.005)
    first = case.simulated(arm, {}).q
    balance = equilibrium(arm, made.pressure.values[0], wrench=held_in_the_world(arm, PUSH_N))
    np.testing.assert_allclose(first[0], balance, atol=1e-9)
    np.testing.assert_allclose(first[20], balance, atol=0.1)  # the readings are noisy
    assert arm.pose(balance, arm.length)[0, 3] < -0.005


def test_states_at_rest_have_the_weight_of_their_run():
    made = record(with_numbers(GUESS, {"link0/damping_b": 1e-7}), hold_s=2.5)
    loaded = replace(made, name="weight", load_kg=LOAD, push_n=PUSH_N)
    found = rests_of([replace(made, name="free"), loaded])
    assert found is not None
    n = len(found.pressure) // 2
    assert found.load_kg == (0.0,) * n + (LOAD,) * n
    assert found.push_n == ((0.0, 0.0, 0.0),) * n + (PUSH_N,) * n


@pytest.mark.slow
def test_the_file_states_the_deviation_of_the_scale(tmp_path):
    free = record(scaled(0.9), hold_s=0.4)
    loaded = record(scaled(0.9).replace(tip_mass=GUESS.tip_mass + LOAD), hold_s=0.4, seed=2)
    both = [replace(free, name="free"), replace(loaded, name="weight", load_kg=LOAD)]
    options = IdentificationOptions(dt_s=0.005, rate_hz=20.0, laws=(), is_constant=True, starts=1)
    found = identify(GUESS, both, options)
    path = tmp_path / "arm.yaml"
    path.write_text(robot_text(found, ["free", "weight"]), encoding="utf-8")
    read = load_robot(path)
    assert 0.0 < read.calibration.gain_std < 0.03
    moment = found.solution.values["link0/gain"] * found.solution.values["link0/arm"]
    assert moment == pytest.approx(0.9, rel=0.03)
    assert "Scale of gains" in path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("other=20g", ("free", "RUN=MASS")),
        ("free", ("20g",)),
        ("free=20mm", ("kg",)),
        ("free=0", ("0.0001 kg",)),
    ],
)
def test_a_load_that_cannot_be_is_refused(text, names):
    made = replace(record(GUESS, hold_s=0.1), name="free")
    with refused("--known-load", names=names):
        command._loaded([made], [text], [])
    assert command._loaded([made], ["free=20g"], [])[0].load_kg == LOAD


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("other=80mN,0,0", ("free", "RUN=FORCE")),
        ("free=80mN", ("three",)),
        ("free=0,0,0", ("not all 0",)),
        ("free=8g,0,0", ("N",)),
    ],
)
def test_a_push_that_cannot_be_is_refused(text, names):
    made = replace(record(GUESS, hold_s=0.1), name="free")
    with refused("--known-push", names=names):
        command._loaded([made], [], [text])
    assert command._loaded([made], [], ["free=-80mN,0mN,0mN"])[0].push_n == PUSH_N


def test_the_command_takes_it(tmp_path, monkeypatch):
    from soro_ros.cli import application

    seen = []

    def load(recordings, loads, pushes):
        seen.append((loads, pushes))
        raise ConfigError("test", "stop", "", "")

    monkeypatch.setattr(command, "_loaded", load)
    monkeypatch.setattr(command, "_read", lambda *given: [])
    words = ("tue_three_bellow", str(tmp_path), "--out", str(tmp_path / "new.yaml"))
    more = ("--known-load", "weight=20g", "--known-load", "b=5g", "--known-push", "c=1N,0N,0N")
    CliRunner().invoke(application(), ["identify", *words, *more])
    assert seen == [(["weight=20g", "b=5g"], ["c=1N,0N,0N"])]


@pytest.mark.parametrize("option", ["--known-load=air=20g", "--known-push=air=1N,0N,0N"])
def test_the_air_alone_takes_none(tmp_path, monkeypatch, option):
    from soro_ros.cli import application

    without_shape = replace(record(GUESS, hold_s=0.1), name="air", plates=())
    monkeypatch.setattr(command, "_read", lambda *given: [without_shape])
    words = ("identify", "tue_three_bellow", str(tmp_path), "--out", str(tmp_path / "new.yaml"), option)
    with refused(*option.split("=", 1)):
        CliRunner().invoke(application(), words, catch_exceptions=False, standalone_mode=False)
