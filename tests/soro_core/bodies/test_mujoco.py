"""MuJoCo as outside witness: bodies that slip, are squeezed, and are dragged."""

import numpy as np
import pytest

from soro_core import BaseState
from soro_core.bodies import BallShape, BodyWorld, BoxShape, CapsuleShape, Hinge, RigidBody, simulate_world
from tests.soro_core.bodies.scenes import BETWEEN, RADIUS, WEIGHT, crossing_beams, ground, lower_beam, tilt

mujoco = pytest.importorskip("mujoco", reason="no outside witness: pip install 'soro[witness]' (mujoco)")

# Stiff contacts, elliptic cones, little impedance against slip.
HEAD = """<option timestep="2e-4" cone="elliptic" impratio="100" integrator="implicitfast"/>
<default><geom solref="2e-3 1" solimp="0.99 0.999 1e-4" condim="3"/></default>"""


def load(body, gravity, assets=""):
    """Make a model; gives model and data."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{HEAD}{assets}<worldbody>{body}</worldbody></mujoco>")
    model.opt.gravity = gravity
    return model, mujoco.MjData(model)


def play(body, seconds, gravity=(0.0, 0.0, -WEIGHT), assets="", **controls):
    """Run a model; gives model and data."""
    model, data = load(body, gravity, assets)
    for name, values in controls.items():
        getattr(data, name)[:] = values
    while data.time < seconds:
        mujoco.mj_step(model, data)
    return model, data


def contact_forces(model, data, seconds=0.05):
    """Mean normal and friction force of each contact over a time, (n, 2)."""
    rows, f, end = [], np.zeros(6), data.time + seconds
    while data.time < end:
        mujoco.mj_step(model, data)
        found = np.zeros((8, 2))
        for c in range(data.ncon):
            mujoco.mj_contactForce(model, data, c, f)
            found[c] = f[0], np.hypot(f[1], f[2])
        rows.append(found)
    mean = np.mean(rows, axis=0)
    return mean[mean[:, 0] > 0.0]


def slides(deg, friction):
    """Speeds of a box on a slope after 0.5 s, of ours and of MuJoCo."""
    out = np.array([np.sin(np.deg2rad(deg)), 0.0, np.cos(np.deg2rad(deg))])
    body = RigidBody(
        shape=BoxShape(size=[0.04, 0.03, 0.02]),
        mass=0.05,
        position=list(0.01 * out),
        quaternion=tilt(deg),
        friction=friction,
    )
    ours = simulate_world(BodyWorld({"slope": ground(deg, friction=1.0), "box": body}), t_end=0.5)
    pull = (WEIGHT * np.sin(np.deg2rad(deg)), 0.0, -WEIGHT * np.cos(np.deg2rad(deg)))
    _, data = play(
        f"""<geom type="plane" size="5 5 1" friction="{friction} 0 0"/>
        <body pos="0 0 0.01"><freejoint/><geom type="box" size="0.02 0.015 0.01" mass="0.05"
        friction="{friction} 0 0"/></body>""",
        0.5,
        gravity=pull,
    )
    return np.linalg.norm(ours.twist["box"][-1, 3:]), float(data.qvel[0])


@pytest.mark.parametrize("friction", [0.3, 0.7])
def test_a_box_slips_at_the_same_angle(friction):
    angle = np.rad2deg(np.arctan(friction))
    for deg, moves in ((angle - 0.4, False), (angle + 0.4, True)):
        ours, theirs = slides(deg, friction)
        assert (ours > 0.01) == (theirs > 0.01) == moves, (deg, ours, theirs)


def test_a_box_slides_as_fast():
    ours, theirs = slides(25.0, 0.3)
    assert ours == pytest.approx(theirs, rel=0.02)


def test_a_dragged_box_has_the_same_forces():
    """A force of 0.2 N across, below the limit of 0.24 N, and of 0.4 N, above it."""
    for pull, friction in ((0.2, 0.2), (0.4, 0.5 * 0.049 * WEIGHT)):
        body = RigidBody(
            shape=BoxShape(size=[0.04, 0.04, 0.02]), mass=0.049, position=[0, 0, 0.01], friction=0.5
        )
        ours = simulate_world(
            BodyWorld({"ground": ground(friction=1.0), "box": body}),
            t_end=0.3,
            wrenches={"box": [0.0, 0.0, 0.0, 0.6 * pull, 0.8 * pull, 0.0]},
        )
        model, data = play(
            """<geom type="plane" size="5 5 1" friction="0.5 0 0"/><body pos="0 0 0.01"><freejoint/>
            <geom type="box" size="0.02 0.02 0.01" mass="0.049" friction="0.5 0 0"/></body>""",
            0.3,
            xfrc_applied=[[0.0] * 6, [0.6 * pull, 0.8 * pull, 0.0, 0.0, 0.0, 0.0]],
        )
        theirs = contact_forces(model, data).sum(axis=0)
        force = ours.contact_force("box")[-1]
        # Where it slides, theirs hops: its share of friction remains.
        assert np.hypot(*force[:2]) / force[2] == pytest.approx(theirs[1] / theirs[0], rel=0.02)
        assert force[2] == pytest.approx(0.049 * WEIGHT, rel=1e-3)
        assert np.hypot(*force[:2]) == pytest.approx(friction, rel=0.02)


def test_a_ball_between_plates_has_the_same_forces():
    """A hinged plate presses a ball against a wall; friction carries the ball."""
    moment = 0.06
    plate = {"shape": BoxShape(size=[0.01, 0.06, 0.12]), "friction": 0.8}
    bodies = {
        "wall": RigidBody(**plate, fixed=True, position=[-0.025, 0.0, 0.0]),
        "plate": RigidBody(
            **plate,
            mass=0.05,
            position=[0.025, 0.0, 0.0],
            hinge=Hinge(point=[0.025, 0.0, 0.06], axis=[0.0, 1.0, 0.0]),
        ),
        "ball": RigidBody(shape=BallShape(radius=0.02), mass=0.04, friction=0.8),
    }
    ours = simulate_world(BodyWorld(bodies), t_end=0.5, wrenches={"plate": [0.0, moment, 0.0, 0.0, 0.0, 0.0]})
    assert ours.status.ok
    model, data = play(
        """<geom type="box" pos="-0.025 0 0" size="0.005 0.03 0.06" friction="0.8 0 0"/>
        <body pos="0.025 0 0.06"><joint type="hinge" axis="0 1 0" damping="1e-5"/>
        <geom type="box" pos="0 0 -0.06" size="0.005 0.03 0.06" mass="0.05" friction="0.8 0 0"/></body>
        <body><freejoint/><geom type="sphere" size="0.02" mass="0.04" friction="0.8 0 0"/></body>""",
        0.5,
        qfrc_applied=[moment, *[0.0] * 6],
    )
    theirs = contact_forces(model, data)
    rows = ours.contacts.step == len(ours.t) - 1
    force, normal = ours.contacts.force[rows], ours.contacts.normal[rows]
    along = (force * normal).sum(axis=1)
    across = np.linalg.norm(force - along[:, None] * normal, axis=1)
    assert len(theirs) == len(force) == 2
    np.testing.assert_allclose(np.sort(along), np.sort(theirs[:, 0]), rtol=0.02)
    np.testing.assert_allclose(np.sort(across), np.sort(theirs[:, 1]), rtol=0.02)
    assert np.abs(ours.twist["ball"][-1]).max() < 1e-6


def pulled_from_rigid_fingers(moment=0.03, friction=0.5, rate=0.5):
    """Pull and weight with which a ball has slipped 1 mm out of three hinged rods, of ours and of MuJoCo."""
    rod = {"shape": CapsuleShape(radius=0.01, length=0.1), "mass": 0.05, "friction": friction}
    text = f"""<body><freejoint/>
        <geom type="sphere" size="0.016" mass="0.03" friction="{friction} 0 0"/></body>"""
    bodies = {"ball": RigidBody(shape=BallShape(radius=0.016), mass=0.03, friction=1.0)}
    wrenches = {"ball": lambda t: [0.0] * 5 + [-rate * t]}
    for k in range(3):
        c, s = (float(f(2.0 * np.pi * k / 3.0)) for f in (np.cos, np.sin))
        hinge = Hinge(point=[0.026 * c, 0.026 * s, 0.06], axis=[-s, c, 0.0])
        bodies[f"rod{k}"] = RigidBody(**rod, position=[0.026 * c, 0.026 * s, 0.0], hinge=hinge)
        wrenches[f"rod{k}"] = [-s * moment, c * moment, 0.0, 0.0, 0.0, 0.0]
        text += f"""<body pos="{0.026 * c} {0.026 * s} 0.06"><joint type="hinge" axis="{-s} {c} 0"/><geom
            type="capsule" size="0.01 0.05" pos="0 0 -0.06" mass="0.05" friction="{friction} 0 0"/></body>"""
    ours = simulate_world(BodyWorld(bodies), t_end=1.5, wrenches=wrenches)
    assert ours.status.ok, ours.status
    model, data = load(text, (0.0, 0.0, -WEIGHT))
    data.qfrc_applied[6:] = moment
    while data.qpos[2] > -1e-3:
        data.xfrc_applied[1, 2] = -rate * data.time
        mujoco.mj_step(model, data)
    out = ours.t[np.argmax(ours.place["ball"][:, 2] < -1e-3)]
    return rate * out + 0.03 * WEIGHT, rate * data.time + 0.03 * WEIGHT


def test_rigid_fingers_lose_a_ball_at_the_same_pull():
    """Closed form: 3 mu N with 60 mm N + 10 mm mu N = moment about each hinge; then it falls by 1 mm."""
    ours, theirs = pulled_from_rigid_fingers()
    assert ours == pytest.approx(theirs, rel=0.02)
    limit = 3.0 * 0.5 * 0.03 / (0.06 + 0.5 * 0.01)
    assert ours == pytest.approx(limit + 0.5 * (6.0 * 0.03 * 1e-3 / 0.5) ** (1.0 / 3.0), rel=0.005)


def cantilever(name, place, quaternion, pieces=20):
    """A beam of capsules, with a spring in the middle of each piece of its length."""
    part = 0.2 / pieces
    stiffness = 5e7 * np.pi * RADIUS**4 / 4.0 / part
    touches = {"low": 'contype="1" conaffinity="2"', "high": 'contype="2" conaffinity="1"'}[name]
    text = f'<body name="{name}" mocap="true" pos="{place}" quat="{quaternion}">'
    for k in range(pieces):
        long = part if k < pieces - 1 else 0.5 * part
        text += f"""<body pos="{part if k else 0.5 * part} 0 0">
            <joint type="ball" stiffness="{stiffness}" damping="{1e-3 * stiffness}"/>
            <geom type="capsule" size="{RADIUS}" fromto="0 0 0 {long} 0 0" density="1100" friction="0.5 0 0"
            {touches}/>"""
    return text + "</body>" * (pieces + 1)


def test_crossed_beams_press_with_the_same_forces():
    """The upper one is lowered by 2 mm."""
    at, reach, half, move = 0.15, 0.18, np.sqrt(0.5), lower_beam(2e-3)
    high = f"{at} {-reach} {2.0 * RADIUS + BETWEEN}", f"{half} 0 0 {half}"
    model, data = load(cantilever("low", "0 0 0", "1 0 0 0") + cantilever("high", *high), (0.0, 0.0, 0.0))
    start = data.mocap_pos[1].copy()
    while data.time < 0.45:
        data.mocap_pos[1] = start + move(data.time).displacement
        mujoco.mj_step(model, data)
    theirs = contact_forces(model, data).sum(axis=0)
    world = crossing_beams(at, reach)
    ours = simulate_world(world, t_end=0.5, motions={"low": lambda t: BaseState(), "high": move})
    assert ours.status.ok, ours.status
    press = ours.normal_force("low")[-1]
    across = np.sqrt(np.sum(ours.contact_force("low")[-1] ** 2) - press**2)
    assert press == pytest.approx(theirs[0], rel=0.02)
    assert across == pytest.approx(theirs[1], abs=0.02 * theirs[0])
