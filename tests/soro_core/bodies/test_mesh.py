"""Convex meshes as bodies: mass, distance, contact and motion, against other libraries and closed forms."""

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from soro_core._jit import kernel
from soro_core.bodies import (
    Attachment,
    BodyMotion,
    BodyWorld,
    BoxShape,
    CylinderShape,
    Hinge,
    MeshShape,
    RigidBody,
    WorldState,
    WorldStepper,
    simulate_world,
)
from soro_core.bodies.polyhedron import corners_of_mesh, polyhedron
from soro_core.bodies.stepping.polyhedra import polyhedron_distance
from soro_core.bodies.stepping.records import ABOUT_AXIS
from soro_core.bodies.world import body_tables
from soro_core.config import parse
from soro_core.errors import ConfigError
from tests.soro_core.bodies.scenes import WEIGHT, close, fingers, grip, ground, lowered, tilt

BOX = [[x, y, z] for x in (-0.02, 0.02) for y in (-0.015, 0.015) for z in (-0.01, 0.01)]
# A wedge: its edge is above one side of its foot; its faces are not square to each other.
WEDGE = [[0, 0, 0], [0.04, 0, 0], [0, 0.03, 0], [0.04, 0.03, 0], [0, 0, 0.03], [0, 0.03, 0.02]]


def mesh(rows):
    return MeshShape(corners=np.ravel(rows).tolist())


def prism(radius, half):
    """Corners of one with six sides."""
    turns = np.arange(6) * np.pi / 3
    return [[radius * np.cos(a), radius * np.sin(a), z] for a in turns for z in (-half, half)]


def stone(seed, n=20, size=0.02):
    """Corners of a random body, at places of their own."""
    rows = np.random.default_rng(seed).normal(size=(n, 3))
    return size * rows / np.linalg.norm(rows, axis=1)[:, None] * [1.0, 0.8, 0.5] + [0.1, 0.0, -0.2]


@pytest.mark.parametrize(
    "rows", [BOX, WEDGE, stone(0), stone(1, n=60)], ids=["box", "wedge", "stone", "round"]
)
def test_mass_is_that_of_another_library(rows):
    trimesh = pytest.importorskip("trimesh", reason="no outside witness: trimesh")
    ours, theirs = polyhedron(tuple(np.ravel(rows).tolist())), trimesh.convex.convex_hull(np.array(rows))
    assert ours.volume == pytest.approx(theirs.volume, rel=1e-9)
    np.testing.assert_allclose(ours.centre, theirs.center_mass, atol=1e-9)
    np.testing.assert_allclose(ours.inertia_per_mass, theirs.moment_inertia / theirs.volume, atol=1e-12)
    assert len(ours.corners) - len(ours.edges) + len(ours.planes) == 2  # Euler
    moments, axes = ours.principal, ours.axes
    np.testing.assert_allclose(axes * moments @ axes.T, ours.inertia_per_mass, atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)


@kernel
def _distances(tables, points, found, normals):
    scratch = np.zeros((3, 3))
    for k in range(len(points)):
        found[k] = polyhedron_distance(tables, 0, points[k], normals[k], scratch)


@pytest.mark.parametrize("rows", [WEDGE, stone(2)], ids=["wedge", "stone"])
def test_distances_are_those_of_an_optimiser(rows):
    """From outside that to the nearest convex combination of the corners, from inside that to a plane."""
    tables = body_tables(BodyWorld({"one": RigidBody(shape=mesh(rows), mass=0.1)}))
    corners, planes = tables.corner[0], tables.plane[0]
    points = np.random.default_rng(3).normal(size=(300, 3)) * 0.012
    found, normals = np.zeros(len(points)), np.zeros_like(points)
    _distances(tables, points, found, normals)
    for x, d, n in zip(points, found, normals, strict=True):
        share, _ = nnls(np.vstack((corners.T, np.full(len(corners), 10.0))), [*x, 10.0])
        share /= share.sum()
        away = np.linalg.norm(x - share @ corners)
        inside = (planes[:, :3] @ x - planes[:, 3]).max()
        assert d == pytest.approx(away if inside > 0.0 else inside, abs=2e-6)
        assert np.linalg.norm(n) == pytest.approx(1.0)
        if d > 1e-4:
            np.testing.assert_allclose(n, (x - share @ corners) / away, atol=1e-2)
    assert (found > 0.0).sum() > 100
    assert (found < 0.0).sum() > 20


def fall(shape, **keys):
    turned = Rotation.from_euler("xyz", [40.0, 20.0, 10.0], degrees=True).as_quat().tolist()
    body = RigidBody(shape=shape, mass=0.05, position=[0, 0, 0.05], quaternion=turned, **keys)
    return simulate_world(BodyWorld({"ground": ground(), "one": body}), t_end=1.0)


def test_a_box_by_its_corners_is_a_box():
    ours, theirs = fall(mesh(BOX)), fall(BoxShape(size=[0.04, 0.03, 0.02]))
    assert ours.status.ok
    np.testing.assert_allclose(ours.place["one"], theirs.place["one"], atol=1e-7)
    np.testing.assert_allclose(ours.rotation["one"], theirs.rotation["one"], atol=1e-6)


@pytest.mark.parametrize("rows", [WEDGE, stone(4)], ids=["wedge", "stone"])
def test_what_falls_comes_to_rest_on_a_face(rows):
    shape = mesh(rows)
    result = fall(shape, friction=0.6)
    assert result.status.ok, result.status
    assert np.abs(result.twist["one"][-1]).max() < 1e-5
    assert result.contact_force("one")[-1] == pytest.approx(
        [0.0, 0.0, 0.05 * WEIGHT], abs=1e-3 * 0.05 * WEIGHT
    )
    # One of its faces is on the ground, and its centre of mass is above that.
    planes = shape.solid.planes
    down = planes[:, :3] @ result.rotation["one"][-1].T
    face = np.argmin(down[:, 2])
    assert down[face] == pytest.approx([0.0, 0.0, -1.0], abs=1e-3)
    assert result.place["one"][-1, 2] == pytest.approx(planes[face, 3], abs=1e-5)


def test_spin_keeps_its_momentum():
    """By the inertia of the file's axes: the kernels turn about the principal ones."""
    shape = mesh(stone(5))
    body = RigidBody(shape=shape, mass=0.05, angular_velocity=[9.0, -4.0, 12.0], velocity=[0.1, 0, 0])
    result = simulate_world(BodyWorld({"one": body}, gravity=[0, 0, 0]), t_end=1.0, dt=5e-4)
    inertia = 0.05 * shape.solid.inertia_per_mass
    R, spin = result.rotation["one"], result.twist["one"][:, :3]
    np.testing.assert_allclose(R[0], np.eye(3), atol=1e-14)
    momentum = np.einsum("tij,jk,tlk,tl->ti", R, inertia, R, spin)
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (len(R), 1)), rtol=1e-9, atol=1e-15)
    energy = result.energy()
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)
    assert np.abs(R[-1] - R[0]).max() > 0.5


def test_bodies_that_meet_keep_their_momentum():
    one = RigidBody(shape=mesh(WEDGE), mass=0.05, position=[-0.04, 0, 0], velocity=[0.5, 0, 0])
    other = RigidBody(shape=mesh(stone(6)), mass=0.03, angular_velocity=[0, 5.0, 0])
    result = simulate_world(BodyWorld({"one": one, "other": other}, gravity=[0, 0, 0]), t_end=0.3)
    assert result.status.ok, result.status
    assert result.normal_force("one").max() > 1.0  # they have met
    linear = np.zeros((len(result.t), 3))
    angular = np.zeros_like(linear)
    for name, body in result.world.bodies.items():
        inertia, R, V = (
            body.mass * body.shape.solid.inertia_per_mass,
            result.rotation[name],
            result.twist[name],
        )
        linear += body.mass * V[:, 3:]
        angular += np.einsum("tij,jk,tlk,tl->ti", R, inertia, R, V[:, :3])
        angular += body.mass * np.cross(result.place[name], V[:, 3:])
    np.testing.assert_allclose(linear, np.tile(linear[0], (len(linear), 1)), atol=1e-12)
    # A contact acts at the places of the start of its step.
    np.testing.assert_allclose(angular, np.tile(angular[0], (len(angular), 1)), atol=2e-7)


def test_a_pendulum_swings_in_its_time():
    shape, arm = mesh(stone(7)), 0.05
    solid = shape.solid
    body = RigidBody(
        shape=shape,
        mass=0.05,
        position=[0.0, 0.0, -arm],
        hinge=Hinge(point=[0, 0, 0], axis=[0, 1, 0]),
    )
    push = simulate_world(
        BodyWorld({"one": body}), t_end=2.0, dt=5e-4, wrenches={"one": lambda t: [0, 2e-4, 0, 0, 0, 0]}
    )
    inertia = 0.05 * (solid.inertia_per_mass[1, 1] + arm**2)
    period = 2.0 * np.pi * np.sqrt(inertia / (0.05 * WEIGHT * arm))
    rate = push.angle["one"][:, 1]
    up = np.flatnonzero((rate[:-1] < 0.0) & (rate[1:] >= 0.0))
    times = push.t[up] - rate[up] * np.diff(push.t)[up] / (rate[up + 1] - rate[up])
    assert np.diff(times).mean() == pytest.approx(period, rel=1e-3)


def test_a_frustum_stands_until_its_weight_leaves_its_foot():
    """The angle of a slope at which it tips follows from its foot and the height of its centre."""
    foot, top, height = 0.01, 0.02, 0.04
    rows = [[x * s, y * s, z] for s, z in ((foot, 0.0), (top, height)) for x in (-1, 1) for y in (-1, 1)]
    shape = mesh(rows)
    centre = shape.solid.centre[2]
    angle = np.rad2deg(np.arctan(foot / centre))
    for deg, stands in ((angle - 0.5, True), (angle + 0.5, False)):
        place = Rotation.from_quat(tilt(deg)).apply([0.0, 0.0, centre])
        body = RigidBody(shape=shape, mass=0.05, position=place.tolist(), quaternion=tilt(deg), friction=0.8)
        world = BodyWorld({"slope": ground(deg, friction=1.0), "one": body})
        result = simulate_world(world, t_end=1.0)
        assert result.status.ok, result.status
        assert (np.linalg.norm(result.place["one"][-1] - place) < 1e-4) == stands, deg


def test_meshes_stand_on_each_other():
    wide = [[3 * x, 3 * y, z] for x, y, z in BOX]
    bodies = {
        "ground": ground(friction=1.0),
        "slab": RigidBody(shape=mesh(wide), mass=0.1, position=[0, 0, 0.01], friction=0.6),
        "post": RigidBody(shape=mesh(prism(0.015, 0.02)), mass=0.05, position=[0.01, 0, 0.04], friction=0.6),
        "disc": RigidBody(
            shape=CylinderShape(radius=0.012, length=0.01), mass=0.02, position=[0.01, 0, 0.065], friction=0.6
        ),
        "lid": RigidBody(shape=mesh(BOX), mass=0.02, position=[0.012, 0, 0.08], friction=0.6),
    }
    result = simulate_world(BodyWorld(bodies), t_end=2.0)
    assert result.status.ok, result.status
    for name, body in bodies.items():
        if body.mass is not None:
            moved = np.linalg.norm(result.place[name][-1] - result.place[name][1000])
            assert moved < 1e-6, name  # within a second
            assert result.contact_force(name)[-1, 2] == pytest.approx(body.mass * WEIGHT, rel=1e-3)


def test_fingers_hold_a_hexagon():
    turned = Rotation.from_euler("z", 30.0, degrees=True)  # faces towards the fingers
    world = grip(mesh(turned.apply(prism(0.0185, 0.016))), half=0.016)
    result = simulate_world(world, t_end=3.0, pressures=close(world), motions={"table": lowered})
    assert result.status.ok, result.status
    assert result.place["object"][-1, 2] > -0.062
    force = result.contact_force("object")[-200:].mean(axis=0)
    assert force[2] == pytest.approx(0.03 * WEIGHT, rel=1e-3)


def test_an_outside_simulator_has_the_same_forces():
    """A wedge on the ground, pushed along it: at each corner of its foot what MuJoCo finds."""
    mujoco = pytest.importorskip("mujoco", reason="no outside witness: pip install 'soro[witness]' (mujoco)")
    from tests.soro_core.bodies.test_mujoco import contact_forces, play

    assert mujoco
    rows = [[0, 0, 0], [0.05, 0, 0], [0.01, 0.04, 0], [0.02, 0.01, 0.03]]
    shape = mesh(rows)
    corners, height = shape.solid.corners, shape.solid.centre[2]
    body = RigidBody(shape=shape, mass=0.05, position=[0, 0, height], friction=0.6)
    pull = [0.08, 0.05, 0.0]
    ours = simulate_world(
        BodyWorld({"ground": ground(friction=1.0), "one": body}),
        t_end=0.5,
        wrenches={"one": [0, 0, 0, *pull]},
    )
    text = " ".join(f"{x:.12g}" for x in corners.ravel())
    moments, axes = shape.solid.principal, shape.solid.axes
    quat = np.roll(Rotation.from_matrix(axes).as_quat(), 1)
    inertia = " ".join(f"{0.05 * x:.12g}" for x in moments)
    model, data = play(
        f"""<geom type="plane" size="5 5 1" friction="0.6 0 0"/><body pos="0 0 {height}"><freejoint/>
        <inertial pos="0 0 0" mass="0.05" diaginertia="{inertia}" quat="{" ".join(map(str, quat))}"/>
        <geom type="mesh" mesh="one" friction="0.6 0 0"/></body>""",
        0.5,
        assets=f'<asset><mesh name="one" vertex="{text}" inertia="exact"/></asset>',
        xfrc_applied=[[0.0] * 6, [*pull, 0.0, 0.0, 0.0]],
    )
    theirs = contact_forces(model, data)
    rows = ours.contacts.step == len(ours.t) - 1
    normal = (ours.contacts.force[rows] * ours.contacts.normal[rows]).sum(axis=1)
    normal = normal[normal > 1e-4]
    assert len(theirs) == len(normal) == 3
    np.testing.assert_allclose(np.sort(normal), np.sort(theirs[:, 0]), rtol=0.02)
    # In closed form: three corners bear the weight, and the moment of the push about the ground.
    foot = np.array([corners[k] for k in range(3)])
    balance = np.array([np.ones(3), foot[:, 0], foot[:, 1]])
    exact = np.linalg.solve(balance, [0.05 * WEIGHT, pull[0] * height, pull[1] * height])
    np.testing.assert_allclose(np.sort(normal), np.sort(exact), rtol=1e-3)


def turned_about(rows, deg):
    """Corners of the same body in a file whose axes are turned, and the quaternion that undoes it."""
    turn = Rotation.from_euler("xyz", deg, degrees=True)
    return mesh(turn.apply(rows)), turn.inv().as_quat().tolist()


@pytest.mark.parametrize("held", ["free", "hinge", "weld", "driven"])
def test_the_axes_of_a_file_change_nothing(held):
    rows, results = stone(9), []
    for deg in ([0.0, 0.0, 0.0], [30.0, -50.0, 70.0]):
        shape, quaternion = turned_about(rows, deg)
        keys = {"shape": shape, "quaternion": quaternion, "position": [0.0, 0.0, 0.04]}
        bodies, arms = {"ground": ground()}, {}
        if held == "hinge":
            keys |= {"mass": 0.05, "hinge": Hinge(point=[0.05, 0.0, 0.08], axis=[0.2, 1.0, 0.0])}
        elif held == "weld":
            arms, bodies = fingers(1), {}
            keys |= {"mass": 0.01, "attached": Attachment(joint="weld"), "position": [0.035, 0.0, -0.07]}
        elif held == "driven":
            keys |= {"fixed": True, "motion": BodyMotion(at_s=[0.0, 0.2], displacement_m=[0.0] * 5 + [0.02])}
            bodies["rider"] = RigidBody(shape=BoxShape(size=[0.01] * 3), mass=0.01, position=[0, 0, 0.07])
        else:
            keys |= {"mass": 0.05, "angular_velocity": [3.0, 9.0, -4.0]}
        bodies["stone"] = RigidBody(**keys)
        stepper = WorldStepper(BodyWorld(bodies, arms))
        state, places, turns = stepper.initial_state(), [], []
        np.testing.assert_allclose(state.rotation[list(bodies).index("stone")], bodies["stone"].rotation)
        for k in range(9):  # later the rider falls from an edge
            result = stepper.step(state, {name: np.zeros((2, 3)) for name in arms}, 0.01, 0.01 * k)
            assert result.status.ok, result.status
            state = WorldState.last_of(result)
            places.append(result.place["stone"][-1])
            turns.append(result.rotation["stone"][-1] @ Rotation.from_quat(quaternion).as_matrix().T)
        rider = state.place[list(bodies).index("rider")] if held == "driven" else 0.0
        about = bodies["stone"].about_hinge()[2] if held == "hinge" else 0.0
        results.append((np.array(places), np.array(turns), rider, about))
    for one, other in zip(*results, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-7)
    if held == "hinge":
        assert about == pytest.approx(
            body_tables(BodyWorld({"one": bodies["stone"]})).hinge[0, ABOUT_AXIS], rel=1e-12
        )


@pytest.mark.parametrize("away", [1.0, 50.0])
def test_far_from_the_origin_of_a_file_a_mesh_is_the_same(away):
    rows = np.array(WEDGE)
    near, far = (
        polyhedron(tuple(rows.ravel())),
        polyhedron(tuple((rows + np.array([away, -away, 0.0])).ravel())),
    )
    np.testing.assert_allclose(far.inertia_per_mass, near.inertia_per_mass, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(far.centre - [away, -away, 0.0], near.centre, atol=1e-12)
    assert len(far.planes) == len(near.planes) == 6


def test_a_thin_rod_is_a_body_and_small_ones_are_not_flat():
    for size in ([1.0, 1e-3, 1e-3], [0.1, 1e-4, 1e-4], [2e-3, 1e-3, 1e-3]):
        rows = np.array(BOX) / [0.04, 0.03, 0.02] * size
        assert polyhedron(tuple(rows.ravel())).volume == pytest.approx(np.prod(size))


@pytest.mark.parametrize(
    ("shape", "names"),
    [
        ({"corners": [*BOX, [0.001, 0.0, 0.0]]}, ("corners", "number 8", "none of the hull")),
        ({"corners": BOX[:3]}, ("span a volume",)),
        ({"corners": [[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0], [0.01, 0.01, 0]]}, ("span a volume",)),
        ({"corners": stone(8, n=61).tolist()}, ("at most 60", "61")),
        ({"corners": [[0, 0]]}, ("rows of 3",)),
        ({"corners": [[1e4 * x for x in row] for row in BOX]}, ("100 m from their origin",)),
        ({}, ("corners", "or file")),
        ({"corners": BOX, "unit_m": 1.0}, ("unit_m", "unknown")),
        ({"corners": [*BOX, BOX[0]]}, ("each once",)),
        ({"file": "no.stl", "unit_m": 0.0}, ("unit_m", "greater than 0")),
        ({"file": "no.stl", "colour": 1}, ("colour", "unknown")),
        ({"file": "."}, ("directory",)),
        ({"file": "no.stl"}, ("no.stl",)),
        ({"file": "no.stl", "corners": BOX}, ("corners", "unknown")),
    ],
)
def test_what_is_no_convex_mesh_is_refused_in_one_line(shape, names):
    with pytest.raises(ConfigError) as error:
        parse({"mass": 0.1, "shape": {"kind": "mesh", **shape}}, RigidBody, where="bodies.one")
    assert "\n" not in str(error.value)
    assert all(name in str(error.value) for name in names), error.value


def test_a_file_is_read_and_one_that_is_not_convex_is_refused(tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="no outside writer: trimesh")
    good = tmp_path / "good.stl"
    trimesh.convex.convex_hull(1e3 * np.array(WEDGE)).export(good)
    shape = parse({"kind": "mesh", "file": str(good)}, MeshShape, where="shape")
    assert shape.solid.volume == pytest.approx(polyhedron(tuple(np.ravel(WEDGE))).volume, rel=1e-5)
    inwards = trimesh.convex.convex_hull(1e3 * np.array(WEDGE))
    inwards.invert()
    inwards.export(tmp_path / "inwards.stl")
    again = parse({"kind": "mesh", "file": str(tmp_path / "inwards.stl")}, MeshShape, where="shape")
    assert again == shape
    # Three boxes in an L: their hull has half of the fourth.
    places = ([0.0, 0.0], [10.0, 0.0], [0.0, 10.0])
    boxes = [trimesh.creation.box([10.0, 10.0, 5.0]).apply_translation([*xy, 0.0]) for xy in places]
    trimesh.util.concatenate(boxes).export(tmp_path / "notched.stl")
    with pytest.raises(ConfigError, match=r"convex mesh; this one fills 85\.7 %"):
        parse({"kind": "mesh", "file": str(tmp_path / "notched.stl")}, MeshShape, where="shape")
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "round.stl")
    with pytest.raises(ConfigError, match="at most 60 corners"):
        parse({"kind": "mesh", "file": str(tmp_path / "round.stl"), "unit_m": 0.01}, MeshShape, where="shape")


def test_what_a_file_gives_is_a_hull_of_its_corners():
    """Blocks with bevels from nothing to a hundredth, in the precision of an STL file."""
    trimesh = pytest.importorskip("trimesh", reason="no outside hull: trimesh")
    rng = np.random.default_rng(10)
    for _ in range(200):
        bevel = 10.0 ** rng.uniform(-7.0, -2.0)
        rows = np.array(
            [np.where(np.arange(3) == k, 1.0, 1.0 - bevel) * corner for k in range(3) for corner in BOX]
        )
        rows = Rotation.random(random_state=rng).apply(rows).astype(np.float32).astype(float)
        hull = trimesh.convex.convex_hull(rows)
        kept = corners_of_mesh(np.array(hull.vertices), np.array(hull.faces))
        solid = polyhedron(tuple(kept.ravel().tolist()))
        assert solid.volume == pytest.approx(hull.volume, rel=1e-4)
        assert len(solid.corners) - len(solid.edges) + len(solid.planes) == 2
