"""The library as a program uses it: names, short texts, shapes, copies, files, other processes, many runs."""

import importlib
import logging
import multiprocessing
import pickle
import sys
import tomllib
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import soro_core
from soro_core import (
    SoftArm,
    equilibrium,
    inverse_kinematics,
    load_robot,
    reachable,
    robot_from_dict,
    save_robot,
    simulate,
    simulate_many,
)
from soro_core.config import config_folder
from soro_core.errors import ConfigError, ModelError
from soro_core.model import checks
from soro_core.model.equilibrium.statics import stable_equilibrium
from soro_core.rotation import quaternion_from_matrix
from tests.refused import fails, refused

SHIPPED = sorted(path.stem for path in (config_folder() / "robots").glob("*.yaml"))
BELLOW = load_robot("tue_three_bellow")
POD = robot_from_dict(
    {
        "links": [
            {
                "length": 0.1,
                "radius": 0.01,
                "mass": 0.03,
                "k_e": [300.0, 0.0, 1.0],
                "k_b": [0.01, 0.0, 1.0],
                "strains": {
                    "bending_x": {"basis": "pod", "modes": 1, "samples": [[1.0], [0.8], [0.5], [0.1], [0.0]]}
                },
            }
        ]
    }
)

CHAMBER = {"angle_rad": 0.0, "area_m2": 8e-5, "offset_m": 9e-3}
RUBBER = {"youngs_modulus": 120e3, "shear_modulus": 40e3}
ROD = {"length": 0.1, "radius": 0.015, "density": 1070.0, "material": RUBBER, "chambers": [CHAMBER]}
GOOD = robot_from_dict({"name": "good", "links": [ROD]})


@pytest.mark.parametrize(
    "package", ["soro_core", "soro_core.control", "soro_core.estimation", "soro_lab.trade"]
)
def test_completion_sees_the_names_before_their_first_use(package):
    module = importlib.import_module(package)
    assert {name for name in dir(module) if not name.startswith("__")} == {*module.__all__} - {"__version__"}
    assert {"__name__", *module.__all__} <= set(dir(module))
    assert dir(module) == sorted(set(dir(module)))


def test_the_library_has_its_version():
    project = tomllib.loads((config_folder().parent / "pyproject.toml").read_text())["project"]
    assert soro_core.__version__ == project["version"]


def test_the_names_of_the_library_are_public():
    wanted = "equilibrium inverse_kinematics reachable Loop Law LawOptions save_robot simulate_many"
    assert set(wanted.split()) <= set(soro_core.__all__)
    assert all(getattr(soro_core, name).__doc__ for name in wanted.split())


def test_what_is_shown_of_an_object_is_short():
    arm = SoftArm(BELLOW)
    run = simulate(arm, t_end=0.01)
    assert repr(BELLOW) == "Robot(tue_three_bellow: 1 link, 0.064 m, 3 coordinates, 3 chambers)"
    assert repr(arm) == f"SoftArm({BELLOW!r}, exact, 7 nodes a link)"
    assert repr(run) == "Result(tue_three_bellow: 6 times to 0.01 s, 3 coordinates, ok)"
    assert repr(simulate_many([arm, arm], t_end=0.01)) == "Runs(2 runs, 2 ok)"


def test_backbone_and_poses_are_those_of_pose():
    arm = SoftArm(load_robot("six_link"))
    q = np.random.default_rng(1).normal(size=(3, arm.n_q)) * 0.1
    places = np.linspace(0.0, arm.length, 7)
    every = np.array([[arm.pose(one, s) for s in places] for one in q])
    np.testing.assert_array_equal(arm.poses(q, places), every)
    np.testing.assert_array_equal(arm.poses(q[0], places), every[0])
    np.testing.assert_array_equal(arm.poses(q, places[2]), every[:, 2])
    np.testing.assert_array_equal(arm.poses(q[0], places[2]), every[0, 2])
    np.testing.assert_array_equal(arm.backbone(q, 7), every[..., :3, 3])
    np.testing.assert_array_equal(arm.backbone(q[0], 7), every[0, :, :3, 3])
    assert arm.backbone(q[0]).shape == (50, 3)
    for n in (1, 2.5, True, "many"):
        with fails(ModelError, "2 or more", key="n"):
            arm.backbone(q[0], n)


def test_inverse_kinematics_needs_a_place_alone():
    arm = SoftArm(BELLOW)
    q = np.array([0.1, 8.0, -5.0])
    pose = arm.pose(q, arm.length)
    found = inverse_kinematics(arm, pose[:3, 3])
    assert found.position_error_m < 1e-9
    assert found.q == pytest.approx(q, abs=1e-6)
    far = inverse_kinematics(arm, [1.0, 0.0, 0.0])
    assert far.position_error_m == pytest.approx(
        np.linalg.norm([1.0, 0.0, 0.0] - arm.pose(far.q, arm.length)[:3, 3])
    )
    assert far.position_error_m > 0.9
    turned = inverse_kinematics(arm, pose[:3, 3], quaternion_from_matrix(pose[:3, :3]), start=0.5 * q)
    assert (turned.position_error_m, turned.rotation_error_rad) == pytest.approx((0.0, 0.0), abs=1e-7)
    tilted = inverse_kinematics(arm, pose[:3, 3], [0.0, 0.0, 0.0, 1.0])
    assert found.rotation_error_rad == 0.0  # of a free one
    assert 0.0 < tilted.rotation_error_rad < np.arccos(pose[2, 2])
    for key, given in (
        ("position", {"position": [0.0, np.nan, 0.0]}),
        ("position", {"position": [0.0, 0.0]}),
        ("start", {"position": [0.0, 0.0, 0.06], "start": [0.0]}),
        ("orientation", {"position": [0.0, 0.0, 0.06], "orientation": [0.0, 0.0, 0.0, 2.0]}),
    ):
        with fails(ModelError, key, key=key):
            inverse_kinematics(arm, **given)


def test_reachable_takes_the_range_of_the_robot():
    arm = SoftArm(BELLOW.with_({"links[0].chambers": BELLOW.links[0].chambers[:1]}))
    found = reachable(arm)
    assert (found.pressure_pa.min(), found.pressure_pa.max()) == BELLOW.pressure_range_pa
    q = equilibrium(arm, [0.0])
    assert found.tip_m[0] == pytest.approx(arm.pose(q, arm.length)[:3, 3], abs=1e-9)


def test_a_value_is_changed_by_its_path():
    changed = BELLOW.with_(
        {"links[0].k_b[0]": 0.5, "gravity[2]": 0.0, "links[0].chambers[1].dead_band_pa": 10.0}
    )
    assert changed.links[0].k_b == (0.5, *BELLOW.links[0].k_b[1:])
    assert changed.gravity == (0.0, 0.0, 0.0)  # the default otherwise
    assert [c.dead_band_pa for c in changed.links[0].chambers] == [
        c.dead_band_pa if k != 1 else 10.0 for k, c in enumerate(BELLOW.links[0].chambers)
    ]
    assert BELLOW.with_({"links[0].k_b[0]": BELLOW.links[0].k_b[0]}) == BELLOW
    assert POD.with_({"links[0].strains.bending_x.modes": 1}) == POD
    assert BELLOW.with_({"links[0].strains.bending_x.basis": "constant"}).n_q == 3  # strains are not stated
    for path, names in {
        "links[3].mass": ("below 1", "links[0]"),
        "links[0].k_b[7]": ("below 3", "links[0].k_b[0]"),
        "links[0].k_b[0].x": ("all of links[0].k_b[0]",),
        "links[0]..mass": ("links[0].k_b[0]",),
        "": ("links[0].k_b[0]",),
        "gravity[-1]": ("links[0].k_b[0]",),
        "nothing.at.all": ("the robot", "tip_mass"),
        "links[0].kb[0]": ("links[0]: length", "did you mean k_b?"),
        "links[0].material.youngs_modulus": ("links[0].k_b[0]", "either material, or k_e and k_b"),
        "links[0].strains.bending_x.ordr": ("did you mean order?",),
    }.items():
        with refused(path, names=names) as caught:
            BELLOW.with_({path: 1.0})
        assert caught.value.where == BELLOW.name
    with refused("links[0].wings"):
        BELLOW.with_({"links[0].wings": 1.0})
    with refused("links[0].radius"):
        BELLOW.with_({"links[0].radius": -1.0})


@pytest.mark.parametrize("robot", [*map(load_robot, SHIPPED), POD], ids=[*SHIPPED, "pod"])
def test_a_saved_robot_is_read_as_the_same(robot, tmp_path):
    save_robot(robot, tmp_path / "saved.yaml")
    assert load_robot(tmp_path / "saved.yaml") == robot


def test_numbers_of_numpy_are_saved_and_a_wrong_path_is_named(tmp_path):
    changed = BELLOW.with_({"links[0].radius": np.float64(1e-5), "gravity": np.array([0.0, 0.0, 1e-7])})
    save_robot(changed, str(tmp_path / "saved.yaml"))
    assert load_robot(tmp_path / "saved.yaml") == changed
    for path in (tmp_path / "saved.txt", tmp_path / "nowhere" / "saved.yaml"):
        with pytest.raises(ConfigError, match=path.name):
            save_robot(BELLOW, path)


def moved(arm):
    """What a spawned process computes."""
    return arm, arm.pose(np.full(arm.n_q, 0.01), arm.length), simulate(arm, t_end=0.01).q


@pytest.mark.slow
def test_an_arm_and_a_run_pass_into_a_process_and_back():
    arm = SoftArm(BELLOW, nodes=9)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        again, pose, q = pool.apply(moved, (arm,))
    assert (repr(again), again.robot) == (repr(arm), BELLOW)
    np.testing.assert_array_equal(pose, moved(arm)[1])
    np.testing.assert_array_equal(q, moved(arm)[2])


def test_an_arm_passes_into_a_worker_of_joblib_and_back():
    """By loky, whose pickles are those of cloudpickle."""
    loky = pytest.importorskip("joblib.externals.loky", reason="joblib is not installed")
    arm = SoftArm(BELLOW, nodes=9)
    with loky.ProcessPoolExecutor(max_workers=1) as workers:
        again, pose, q = workers.submit(moved, arm).result()
    assert (repr(again), again.robot) == (repr(arm), BELLOW)
    np.testing.assert_array_equal(pose, moved(arm)[1])
    np.testing.assert_array_equal(q, moved(arm)[2])


def test_arms_robots_and_runs_pickle():
    arm = SoftArm(POD)
    again, robot, run = pickle.loads(pickle.dumps((arm, POD, simulate(arm, t_end=0.01))))
    assert robot == POD
    np.testing.assert_array_equal(again.stiffness_matrix(np.zeros(1)), arm.stiffness_matrix(np.zeros(1)))
    np.testing.assert_array_equal(run.tip, simulate(arm, t_end=0.01).tip)
    steps = SoftArm(BELLOW, method="mde", steps=5)
    assert (
        repr(pickle.loads(pickle.dumps(steps))) == repr(steps) == f"SoftArm({BELLOW!r}, mde, 5 steps a link)"
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_an_arm_is_built_by_few_calls(name):
    """Some 0.4 us each, so that 3 ms are 8,000 calls; the rod took 14,700."""
    robot = load_robot(name)
    SoftArm(robot)  # kernels
    calls, before = [], sys.getprofile()
    sys.setprofile(lambda _, event, __: calls.append(event) if event in ("call", "c_call") else None)
    try:
        SoftArm(robot)
    finally:
        sys.setprofile(before)
    assert len(calls) < 8000


def test_a_run_has_its_tip_and_draws_itself(tmp_path):
    arm = SoftArm(BELLOW)
    run = simulate(arm, q0=[0.0, 5.0, 0.0], t_end=0.05)
    np.testing.assert_array_equal(run.tip, [arm.pose(q, arm.length)[:3, 3] for q in run.q])
    figure = run.plot()
    assert [len(axes.lines) for axes in figure.axes] == [3, 2, 1, 3]
    np.testing.assert_array_equal(figure.axes[1].lines[0].get_ydata(), run.q[:, 1])
    figure.savefig(tmp_path / "run.png", dpi=30)
    assert len(simulate(SoftArm(POD), t_end=0.01).plot().axes) == 2  # no elongation, no chamber


@pytest.mark.parametrize(
    "name", ["tue_three_bellow", "silicone_rod", "silicone_rod_planar", "3 links", "20 links"]
)
def test_a_picture_is_readable_with_any_number_of_coordinates(name):
    """Its legends are short, beside the panels, and meet neither each other nor the edge."""
    if "links" in name:
        keys = BELLOW.model_dump(exclude_unset=True)
        arm = SoftArm(robot_from_dict({**keys, "links": int(name.split()[0]) * list(keys["links"])}))
    else:
        arm = SoftArm(load_robot(name))
    rows = np.arange(5.0)[:, None] * np.arange(1.0, arm.n_q + 1.0)
    run = replace(
        simulate(arm, t_end=0.0), t=np.linspace(0.0, 1.0, 5), q=1e-4 * rows, pressure=np.ones((5, arm.n_u))
    )
    figure = run.plot()
    figure.draw_without_rendering()
    legends = [axes.get_legend().get_window_extent() for axes in figure.axes]
    for axes, box in zip(figure.axes, legends, strict=True):
        names = [text.get_text() for text in axes.get_legend().get_texts()]
        assert len(set(names)) == len(names) <= 8
        assert axes.bbox.x1 <= box.x0 < box.x1 <= figure.bbox.x1
    assert all(lower.y1 <= upper.y0 for upper, lower in pairwise(legends))
    assert legends[-1].y0 >= figure.bbox.y0
    drawn = [[line for line in axes.lines if len(line.get_xdata())] for axes in figure.axes]
    assert sum(map(len, drawn)) == 3 + arm.n_q + arm.n_u
    for lines in drawn:
        assert len({(str(line.get_color()), line.get_linestyle()) for line in lines}) == len(lines)


def test_many_runs_of_many_robots_are_those_of_each():
    robots = [
        BELLOW.with_({"links[0].k_b[0]": factor * BELLOW.links[0].k_b[0]}) for factor in (0.8, 1.0, 1.3)
    ]
    told = []
    runs = simulate_many(
        robots,
        q0=[0.0, 4.0, 0.0],
        t_end=0.02,
        pressure=[1e3, 0.0, 0.0],
        progress=lambda done, of: told.append((done, of)),
    )
    alone = [simulate(SoftArm(one), [0.0, 4.0, 0.0], t_end=0.02, pressure=[1e3, 0.0, 0.0]) for one in robots]
    assert told == [(1, 3), (2, 3), (3, 3)]
    for name in ("q", "qd", "pressure", "tip"):
        np.testing.assert_array_equal(getattr(runs, name), [getattr(one, name) for one in alone])
    np.testing.assert_array_equal(runs.t, alone[0].t)
    assert runs.ok.all()
    with fails(ModelError, "arm 1", "3 coordinates and 1 inputs", "3 and 3", key="arm"):
        simulate_many([BELLOW, load_robot("srl_one_segment")])
    with fails(ModelError, "SoftArm or Robot", key="arm"):
        simulate_many([])
    with fails(ModelError, "a row a run", key="q0"):
        simulate_many(SoftArm(BELLOW))


def test_arrays_of_runs_hold_nothing_behind_the_end_of_one_that_fails():
    runs = simulate_many(SoftArm(BELLOW), pressure=np.array([[0.0] * 3, [-1e6] * 3]), t_end=0.01, dt=1e-3)
    ends = [len(run.t) for run in runs]
    assert runs.q.shape == (2, 11, 3)
    assert ends[1] < ends[0] == 11
    assert np.isfinite(runs.q[0]).all()
    assert np.isfinite(runs.q[1, : ends[1]]).all()
    assert np.isnan(runs.q[1, ends[1] :]).all()
    assert runs.ok.tolist() == [True, False]


def test_an_interrupt_ends_many_runs_soon():
    begun = []

    def wave(t):
        begun.append(t)
        return np.zeros(3)

    def stop(done, of):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_many([BELLOW] * 200, pressure=wave, t_end=0.004, dt=2e-3, cores=1, progress=stop)
    assert len(begun) < 200


def test_pressures_beyond_the_range_are_named_once(caplog, monkeypatch):
    monkeypatch.setattr(checks, "_noted", set())
    arm = SoftArm(BELLOW)
    with caplog.at_level(logging.WARNING, "soro_core"):
        simulate(arm, pressure=[90e3, 0.0, 0.0], t_end=0.004)
        assert caplog.messages == []
        simulate(arm, pressure=[0.0, 30e6, 0.0], t_end=0.004)
        (line,) = caplog.messages
        assert all(text in line for text in ("link0/chamber1", "3e+07 Pa", "0 to 90000 Pa", BELLOW.name))
        simulate(arm, pressure=[0.0, 30e6, 0.0], t_end=0.004)
        stiffer = SoftArm(BELLOW.with_({"links[0].k_b[0]": 0.01}))
        simulate(stiffer, pressure=[0.0, 30e6, 0.0], t_end=0.004)
        assert caplog.messages == [line]
        caplog.clear()
        other = SoftArm(BELLOW.replace(name="other"))
        simulate_many(other, pressure=np.array([[0.0] * 3, [0.0, 0.0, -5e3], [95e3, 0.0, 0.0]]), t_end=0.004)
        (line,) = caplog.messages
        assert all(text in line for text in ("link0/chamber2", "-5000 Pa", "run 1"))


def test_an_equilibrium_beyond_the_range_is_named_once_and_noise_is_none(caplog, monkeypatch):
    monkeypatch.setattr(checks, "_noted", set())
    arm = SoftArm(BELLOW)
    with caplog.at_level(logging.WARNING, "soro_core"):
        equilibrium(arm, [-300.0, 92e3, 0.0])
        simulate(arm, pressure=[-300.0, 92e3, 0.0], t_end=0.004)
        assert caplog.messages == []
        for _ in range(2):
            equilibrium(arm, [0.0, 110e3, 0.0])
        (line,) = caplog.messages
        assert all(text in line for text in ("equilibrium", "link0/chamber1", "0 to 90000 Pa", BELLOW.name))


def test_an_arm_that_stands_and_buckles_says_so(caplog):
    """At rest, where the straight arm balances but does not stay, and where the search fails."""
    soft = {"links[0].radius": 0.006, "links[0].material": {"youngs_modulus": 3e3, "shear_modulus": 1e3}}
    arm = SoftArm(GOOD.with_({"name": "standing", **soft}))
    says = ("standing", "buckles", "unstable", "base_quaternion: [1, 0, 0, 0]", "stable_equilibrium")
    equilibrium(arm, [0.0])
    equilibrium(SoftArm(arm.robot.replace(name="hung", base_quaternion=(1.0, 0.0, 0.0, 0.0))), [0.0])
    (line,) = caplog.messages
    with fails(ModelError, *says, key="equilibrium"):
        equilibrium(arm, [5e3])
    assert all(text in line for text in says)
    assert np.abs(soro_core.stable_equilibrium(arm, [0.0])[1:]).max() > 1.0


@pytest.mark.parametrize("mass", [-0.01, np.nan, np.inf, "10g", None])
@pytest.mark.parametrize("rest", [equilibrium, stable_equilibrium])
def test_an_added_mass_that_cannot_be_is_refused(rest, mass):
    with fails(ModelError, key="added_tip_mass"):
        rest(SoftArm(BELLOW), np.zeros(3), np.zeros(3), mass)


def test_a_stable_equilibrium_refuses_pressures_that_are_none():
    for pressure in ([np.nan, 0.0, 0.0], [0.0, 0.0]):
        with fails(ModelError, key="pressure"):
            stable_equilibrium(SoftArm(BELLOW), pressure)


def test_a_robot_in_mm_and_g_is_named(caplog):
    link = {"length": 64.0, "radius": 15.0, "mass": 17.0, "k_e": [300.0, 0.0, 1.0], "k_b": [0.01, 0.0, 1.0]}
    with caplog.at_level(logging.WARNING, "soro_core"):
        robot_from_dict({"links": [link]})
        (line,) = caplog.messages
        assert all(text in line for text in ("links[0]", "kg/m^3", "units are kg and m"))
        caplog.clear()
        for name in SHIPPED:
            load_robot(name)
        assert not [line for line in caplog.messages if "units are" in line]


LAWS = {"links[0].material": None, "links[0].k_e": (300.0, 0.0, 1.0), "links[0].k_b": (0.01, 0.0, 1.0)}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        (
            {"links[0].material": {"youngs_modulus": 0.12, "shear_modulus": 0.04}},
            "links[0].material.youngs_modulus",
        ),  # MPa
        ({"links[0].material.shear_modulus": 0.04}, "links[0].material.shear_modulus"),
        (LAWS | {"links[0].k_e": (1e-3, 0.0, 1.0)}, "links[0].k_e, k_b"),
        ({"links[0].length": 6.4}, "links[0]"),  # cm
        ({"links[0].chambers[0].area_m2": 80.0}, "links[0].chambers[0]"),  # mm^2
        ({"links[0].chambers[0].offset_m": 9.0}, "links[0].chambers[0]"),  # mm
        ({"tip_mass": 20.0}, "tip_mass"),  # g
        ({"pressure_range_pa": (0.0, 90.0)}, "pressure_range_pa"),  # kPa
    ],
)
def test_a_value_in_another_unit_is_named(changes, key, caplog, tmp_path):
    for robot in (GOOD, GOOD.with_(LAWS), GOOD.with_(changes)):
        save_robot(robot, tmp_path / "mine.yaml")
        load_robot(tmp_path / "mine.yaml")
    (line,) = [line for line in caplog.messages if "units are kg and m, Pa and N" in line]
    assert f": {key}" in line


@pytest.mark.parametrize("material", [{"youngs_modulus": 1e5}, {"youngs_modulus": 1e5, "poisson_ratio": 0.5}])
def test_a_material_by_poissons_ratio_is_told_the_shear_modulus(material):
    with pytest.raises(ConfigError, match=r"shear_modulus.* youngs_modulus / .*Poisson's ratio.*rubber"):
        robot_from_dict({"links": [{**ROD, "material": material}]})


def test_a_law_beside_a_material_is_told_what_states_the_stiffness():
    with refused("links[0].k_b[0]", names=("links[0].material.youngs_modulus", "either material, or")):
        GOOD.with_({"links[0].k_b[0]": 0.01})


MATERIAL = {"youngs_modulus": 180e3, "shear_modulus": 60e3, "viscosity": 100.0}
TAPER = [{"place": 0.0, "radius": 15.0}, {"place": 120.0, "radius": 8.0}]


@pytest.mark.parametrize(
    "keys",
    [
        {"length": 120.0, "radius": 15.0, "density": 1070.0},  # mm
        {"length": 120.0, "radius": 15.0, "density": 1.07e-3},  # and g/mm^3
        {"length": 12.0, "radius": 1.5, "density": 1070.0},  # cm
        {"length": 2.0, "radius": 0.5, "density": 1070.0},  # mm, tiny
        {"length": 0.12, "radius": 15.0, "density": 1070.0},
        {"length": 120.0, "radius": 0.015, "density": 1070.0},
        {"length": 120.0, "sections": TAPER, "density": 1070.0},
    ],
)
def test_an_arm_in_mm_is_named_whatever_its_density(keys, caplog):
    with caplog.at_level(logging.WARNING, "soro_core"):
        robot_from_dict({"links": [{**keys, "material": MATERIAL}]}, "mine")
        (line,) = [line for line in caplog.messages if "units are kg and m" in line]
        assert line.startswith("mine: links[0]: ")
        caplog.clear()
        robot_from_dict({"links": [{"length": 3.0, "radius": 0.03, "density": 1070.0, "material": MATERIAL}]})
        assert caplog.messages == []


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda arm, q: arm.poses(q, "abc"), "s"),
        (lambda arm, q: arm.poses(q, [[0.0, 0.01]]), "s"),
        (lambda arm, q: arm.poses(q, [[0.0], [0.0, 0.01]]), "s"),
        (lambda arm, q: inverse_kinematics(arm.robot, [0.0, 0.0, 0.06]), "arm"),
        (lambda arm, q: inverse_kinematics(arm, [0.0, 0.0, 0.06], limit=np.zeros(3)), "limit"),
        (lambda arm, q: inverse_kinematics(arm, [0.0, 0.0, 0.06], limit=[np.nan, 1.0, 1.0]), "limit"),
        (lambda arm, q: inverse_kinematics(arm, [0.0, 0.0, 0.06], start=[np.nan, 1.0, 1.0]), "start"),
        (
            lambda arm, q: inverse_kinematics(arm, [0.0, 0.0, 0.06], rotation_weight_m=np.nan),
            "rotation_weight_m",
        ),
        (lambda arm, q: reachable(arm.robot), "arm"),
        (lambda arm, q: reachable(arm, 60e3, 0.0), "minimum_pa"),
        (lambda arm, q: reachable(arm, -1e3), "minimum_pa"),
        (lambda arm, q: reachable(arm, 0.0, np.nan), "maximum_pa"),
        (lambda arm, q: reachable(arm, "low"), "minimum_pa"),
        (lambda arm, q: reachable(arm, load_kg=-1.0), "load_kg"),
    ],
)
def test_an_argument_that_cannot_be_is_named(call, key):
    arm = SoftArm(load_robot("tue_three_bellow"))
    with fails(ModelError, key=key) as caught:
        call(arm, np.zeros(3))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("changes", [{5: 1.0}, [("tip_mass", 0.1)], None])
def test_changes_that_are_no_mapping_of_paths_are_refused(changes):
    with refused(""):
        load_robot("tue_three_bellow").with_(changes)
