"""Bending angles have a direction: a planar limb is found whichever way it bends, and no stream is blind."""

from __future__ import annotations

import numpy as np
import pytest
from made_recordings import write_csv

from soro_core.config import parse
from soro_core.errors import ConfigError
from soro_core.model import SoftArm
from soro_core.robot import Robot, robot_from_dict
from soro_lab.identification.arm.cases.case import Whole
from soro_lab.identification.arm.cases.parameters import with_numbers
from soro_lab.identification.arm.cases.predict import predict_measurement
from soro_lab.identification.arm.stages import IdentificationOptions, identify
from soro_lab.identification.recording import Bend, Columns, Recording, Series, read_csv, summary
from tests.refused import fails

TRUTH = {"link0/k_b": 0.03, "link0/damping_b": 3e-4}


def limb(*ways: str, chambers_deg: float = 0.0) -> Robot:
    """A limb of one link that bends in the named ways, with two chambers opposite each other."""
    angles = np.radians([chambers_deg, chambers_deg + 180.0])
    link = {
        "length": 0.12,
        "radius": 0.015,
        "mass": 0.05,
        "strains": {way: {} for way in ways},
        "k_e": [2000.0, 0.0, 1.0],
        "k_b": [0.05, 0.0, 1.0],
        "damping": [1.0 if way == "elongation" else 2e-4 for way in ways],
        "chambers": [{"angle_rad": a, "alpha_eps": 2.4e-5, "alpha_kappa": 2.88e-7} for a in angles],
    }
    return robot_from_dict({"gravity": [0.0, 0.0, 0.0], "pressure_range_pa": [0.0, 30e3], "links": [link]})


def made(arm: Robot, towards: float, ways: int = 1) -> Recording:
    """What an exact angle sensor records of the arm under steps of both chambers."""
    t = np.arange(0.0, 24.0, 0.01)
    points = np.array([[0, 0], [20, 0], [0, 0], [0, 15], [10, 5], [30, 0], [0, 0], [0, 25]]) * 1e3
    wanted = points[np.minimum((t / 3.0).astype(int), 7)]
    p = np.zeros_like(wanted)
    for k in range(1, len(t)):
        p[k] = p[k - 1] + 0.2 * (wanted[k - 1] - p[k - 1])
    angle = Bend("angle", t, 0, np.zeros(len(t)), towards)
    run = Recording("made", arm.chamber_names, Series("pressure", t, p), bends=(angle,))
    whole, model = Whole(run, dt=0.005, rate_hz=1e3), SoftArm(arm)
    q = whole.coordinates(whole.simulated(model, {}), {})[0]
    x = q[:, arm.coordinate_names.index("link0/bending_x")] if "bending_x" in arm.links[0].strains else 0.0
    y = q[:, arm.coordinate_names.index("link0/bending_y")] if "bending_y" in arm.links[0].strains else 0.0
    seen = whole.shapes[0].t
    bent = 0.12 * (x * np.cos(towards) + y * np.sin(towards))
    noise = np.random.default_rng(3).normal(0.0, 1e-3, len(seen))
    return Recording(
        "made", run.chambers, run.pressure, bends=(Bend("angle", seen, 0, bent + noise, towards),)
    )


def written(folder, recording: Recording):
    """The recording as a CSV file with degrees."""
    bend, pressure = recording.bends[0], recording.pressure
    p = np.array([np.interp(bend.t, pressure.t, column) for column in pressure.values.T])
    return write_csv(folder / "made.csv", {"t": bend.t, "p0": p[0], "p1": p[1], "a": np.degrees(bend.angle)})


def columns(**bend) -> Columns:
    pressures = {"columns": {"link0/chamber0": "p0", "link0/chamber1": "p1"}}
    found = {"column": "a", "unit": "deg", **bend}
    return parse({"pressures": pressures, "bends": {"angle": found}}, Columns, where="map.yaml")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("way", "chambers_deg", "keys"),
    [("bending_x", 0.0, {}), ("bending_y", 90.0, {"towards_deg": 90.0})],
)
def test_a_planar_limb_is_found_whichever_way_it_bends(tmp_path, way, chambers_deg, keys):
    guess = limb(way, chambers_deg=chambers_deg)
    truth = with_numbers(guess, TRUTH)
    file = written(tmp_path, made(truth, 0.0 if way == "bending_x" else 0.5 * np.pi))
    recording = read_csv(file, columns(**keys), guess)
    assert f"towards {way[-1]}" in summary(recording)
    assert recording.notes == ()
    found = identify(
        guess, [recording], IdentificationOptions(dt_s=0.01, rate_hz=20.0, laws=(), keep=("link0/gain",))
    )
    for name, value in TRUTH.items():
        assert name not in found.kept
        assert found.solution.values[name] == pytest.approx(value, rel=0.03), name
    assert found.held_out_share < 0.02


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0, 200.0])
def test_an_angle_is_that_of_its_direction(angle):
    arm = limb("elongation", "bending_x", "bending_y")
    q = np.array([[0.1, 2.0, -3.0], [0.0, 1.0, 0.0]])
    q = q[:, [("elongation", "bending_x", "bending_y").index(s) for s in arm.links[0].strains]]
    towards = np.radians(angle)
    does = predict_measurement(Bend("a", np.zeros(2), 0, np.zeros(2), towards), arm, SoftArm(arm), q)
    right = [0.12 * 1.1 * (2.0 * np.cos(towards) - 3.0 * np.sin(towards)), 0.12 * np.cos(towards)]
    np.testing.assert_allclose(does, right, atol=1e-12)


def test_what_is_assumed_is_said(tmp_path):
    both = limb("bending_x", "bending_y")
    file = written(tmp_path, made(both, 0.5 * np.pi))
    found = read_csv(file, columns(), both)
    assert found.bends[0].towards == pytest.approx(0.5 * np.pi)
    assert found.notes == ("angle is taken to bend towards y: the map has no bends.angle.towards",)
    assert read_csv(file, columns(towards_rad=0.4), both).bends[0].towards == 0.4
    assert read_csv(file, columns(towards_rad=0.4), both).notes == ()


@pytest.mark.parametrize(
    ("ways", "keys", "key", "words"),
    [
        (("bending_x",), {"towards": "y"}, "bends.angle.towards", ("'y'", "towards x")),
        (("bending_x",), {"towards_deg": 90.0}, "bends.angle.towards_deg", ("90.0", "towards x")),
        (("bending_y",), {"towards": "x"}, "bends.angle.towards", ("'x'", "towards y")),
        (("bending_y",), {"towards_rad": np.pi}, "bends.angle.towards_rad", ("towards y",)),
        (("elongation",), {}, "bends.angle.link", ("a link that bends",)),
    ],
)
def test_a_way_in_which_the_link_cannot_bend_is_refused(tmp_path, ways, keys, key, words):
    file = written(tmp_path, made(limb("bending_x"), 0.0))
    with fails(ConfigError, *words, where="columns", key=key):
        read_csv(file, columns(**keys), limb(*ways))


def test_a_map_has_one_direction():
    with fails(ConfigError, "towards_rad", where="map.yaml", key="bends.angle"):
        columns(towards="x", towards_deg=0.0)
    with fails(ConfigError, where="map.yaml", key="bends.angle.towards"):
        columns(towards="z")


def test_a_stream_that_the_arm_cannot_show_is_named():
    """Of a recording that no map has made: its angle is taken towards y, where the limb bends in x."""
    guess = limb("bending_x")
    recording = made(guess, 0.0)
    blind = Bend("angle", recording.bends[0].t, 0, recording.bends[0].angle)
    with fails(ConfigError, "whatever the arm does", where="made", key="angle"):
        identify(guess, [Recording("made", recording.chambers, recording.pressure, bends=(blind,))])


def test_a_stream_that_no_pressure_moves_is_named():
    """The chambers bend the arm in x alone, and the angle is taken towards y."""
    both = limb("bending_x", "bending_y")
    recording = made(both, 0.0)
    blind = Bend("angle", recording.bends[0].t, 0, recording.bends[0].angle, 0.5 * np.pi)
    options = IdentificationOptions(dt_s=0.02, rate_hz=5.0, laws=(), most=1)
    with fails(ConfigError, "no number of the robot", where="recordings", key="angle"):
        identify(both, [Recording("made", recording.chambers, recording.pressure, bends=(blind,))], options)
