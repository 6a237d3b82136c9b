"""Bodies as they are drawn: closed surfaces of their size, at the place where the run had them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from soro_core.bodies import (
    BallShape,
    BoxShape,
    CapsuleShape,
    CylinderShape,
    GroundShape,
    MeshShape,
    RigidBody,
)
from soro_core.robot import load_robot
from soro_core.rotation import matrix_from_quaternion
from soro_lab.scene import load_scene
from soro_ros.pictures import film
from soro_ros.recordings.bodies.tracks import BodyTrack
from soro_ros.view.access import Access
from soro_ros.view.body_shape import FREE_COLOUR, faces_of, grounds_of, triangles_of
from soro_ros.view.moment import Moment
from soro_ros.view.recorded import RecordedPage
from soro_ros.view.server import ViewServer

BAG = Path(__file__).parents[3] / "bags" / "track_circle_lockstep_2s"
R, L = 0.02, 0.05
VOLUMES = {
    BallShape(radius=R): 4 / 3 * np.pi * R**3,
    CapsuleShape(radius=R, length=L): 4 / 3 * np.pi * R**3 + np.pi * R**2 * L,
    CylinderShape(radius=R, length=L): np.pi * R**2 * L,
    BoxShape(size=[0.01, 0.02, 0.03]): 6e-6,
    MeshShape(corners=[0, 0, 0, 0.03, 0, 0, 0, 0.03, 0, 0, 0, 0.03]): 4.5e-6,
}
TURNED = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]


def pose_at(place, quaternion=(0.0, 0.0, 0.0, 1.0)):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = matrix_from_quaternion(np.array(quaternion)), place
    return pose


@pytest.mark.parametrize("shape", VOLUMES, ids=lambda shape: shape.kind)
def test_the_surface_encloses_the_volume_and_points_outwards(shape):
    vertices, triangles = triangles_of(faces_of(RigidBody(shape=shape, mass=1.0)))
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    volume = np.sum(a * np.cross(b, c)) / 6.0
    assert volume == pytest.approx(VOLUMES[shape], rel=0.05 if shape.kind in ("ball", "capsule") else 0.02)
    size, _ = shape.extents()
    expected = {
        "ball": [R] * 3,
        "capsule": [R, R, R + L / 2],
        "cylinder": [R, R, L / 2],
        "box": size,
        "mesh": [0.0225] * 3,  # a tetrahedron, about its centre of mass
    }[shape.kind]
    assert vertices.max(axis=0) == pytest.approx(expected, rel=0.01)


def test_a_ground_is_a_plane_at_its_place():
    tilted = RigidBody(
        shape=GroundShape(),
        fixed=True,
        position=[0.0, 0.0, 1.0],
        quaternion=[0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)],
    )
    assert len(faces_of(tilted)) == 0
    (plane,) = grounds_of([RigidBody(shape=BallShape(radius=R), mass=1.0), tilted])
    assert plane.point == (0.0, 0.0, 1.0)
    assert plane.normal == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)


def test_a_film_shows_a_body_where_it_was():
    shown = film.take(BAG, load_scene(str(BAG / "scene.yaml")), 0.5, 1.5, 10.0)
    ball = RigidBody(shape=BallShape(radius=R), mass=0.1)
    places = np.array([pose_at([0.05, 0.0, 0.0]), pose_at([0.05, 0.0, 0.06])])
    track = BodyTrack(ball, np.array([0.0, 1.0]), places)
    np.testing.assert_allclose(track.at(0.99), places[0])
    np.testing.assert_allclose(track.at(1.0), places[1])
    figure = film.AnimatedFigure(replace(shown, bodies=[track]))

    def middle(k):
        """Middle of what has the colour of a free body, in the world's directions of the screen [m]."""
        figure.at(k)
        paths, colours = figure._faces.get_paths(), figure._faces.get_facecolor()[:, :3]
        hue = colours / np.maximum(colours.max(axis=1, keepdims=True), 1e-9)
        own = np.abs(hue - FREE_COLOUR / FREE_COLOUR.max()).max(axis=1) < 0.02
        # Faces that are turned away are not drawn.
        assert 100 < own.sum() < 0.6 * len(faces_of(ball))
        seen = np.concatenate([path.vertices[:4] for path, is_own in zip(paths, own, strict=True) if is_own])
        return 0.5 * (seen.min(axis=0) + seen.max(axis=0))

    for k, place in ((0, places[0]), (len(shown.t) - 1, places[1])):
        expected = film.Camera().project(place[:3, 3])[:2]
        np.testing.assert_allclose(middle(k), expected, atol=0.1 * R)


@pytest.mark.process
def test_the_page_of_a_recording_moves_its_bodies():
    server = ViewServer(Access(), 18300)
    try:
        ball = RigidBody(shape=BallShape(radius=R), mass=0.1, position=[0.0, 0.0, 0.5])
        floor = RigidBody(shape=GroundShape(), fixed=True)
        places = np.array([pose_at([0.0, 0.0, 0.5]), pose_at([0.1, 0.0, 0.5], TURNED)])
        tracks = {
            "ball": BodyTrack(ball, np.array([0.0, 1.0]), places),
            "floor": BodyTrack(floor, np.zeros(1), np.eye(4)[None]),
        }
        moments = [Moment(t_s=0.0), Moment(t_s=2.0)]
        player = RecordedPage(server, {"": (load_robot("tue_three_bellow"), moments)}, 10.0, tracks)
        server.get_clients = lambda: {0: None}
        meshes = player._bodies._meshes
        assert set(meshes) == {"ball", "floor"}
        player.step(0.5)
        assert meshes["ball"].position == pytest.approx([0.0, 0.0, 0.5])
        player.step(0.7)
        assert meshes["ball"].position == pytest.approx([0.1, 0.0, 0.5])
        assert meshes["ball"].wxyz == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    finally:
        server.stop()
