"""An arm presses on a wall of the twin that estimator and controller do not know."""

import numpy as np
import pytest

from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of
from soro_core.control.force.press import Press
from soro_core.twin import Twin
from tests.refused import refused

RADIUS_M, BEGIN_S = 0.013, 7.0
# Where the tip meets the wall.
PLACE = np.array([0.012, 0.0, 0.068])


def scene_with(tilt_deg=0.0, stiffness=2000.0, friction=0.3, moves_m_s=0.0, **force):
    """The circling arm beside a wall that the circle does not touch."""
    tilt = np.deg2rad(tilt_deg)
    normal = -np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    wall = {
        "stiffness": stiffness,
        "damping": 1.0,
        "friction": friction,
        "slip_velocity": 0.003,
        "normal": normal.tolist(),
        "point": (PLACE - RADIUS_M * normal).tolist(),
        "velocity_m_s": [moves_m_s, 0.0, 0.0],
        "from_s": BEGIN_S + 2.0,
        "to_s": BEGIN_S + 3.0,
    }
    keys = {
        "platform": "",
        "twin.payload_kg": 0.0,
        "twin.wall": wall,
        "controller.reference": {"curvature_per_m": 4.0, "start_s": 2.0},
        "controller.force": {"approach_speed_m_s": 0.01, **force},
    }
    return load_scene("track_circle", keys)


def run(scene, seconds, wanted):
    """Times since the begin [s] and force on the wall along x [N], and the last tick's command.

    `wanted(controller, state)` gives the reference from the begin on; before, the arm circles, then rests
    3 mm from the wall.
    """
    loop, dt, made = loop_of(scene), 1.0 / scene.rate_hz, []

    def reference(t, inner):
        if t < 4.0:
            return None
        if not made:
            made.append(loop.controller.tip(inner.controller, PLACE - [0.003, 0.0, 0.0]))
        if t > BEGIN_S and len(made) == 1:
            made.append(wanted(loop.controller, inner.controller))
        return made[-1]

    twin = Twin(scene.loaded_robot, scene.twin_node())
    ticks = list(loop.run(twin, round((BEGIN_S + seconds) / dt), dt, reference=reference, before_s=-dt))
    rows = np.array([(tick.t_s - BEGIN_S, -tick.seen.contact_n[0]) for tick in ticks if tick.t_s >= BEGIN_S])
    assert all(tick.command.status.ok for tick in ticks[5:])
    return *rows.T, ticks[-1]


def pressing(newton):
    return lambda controller, state: controller.press(state, [newton, 0.0, 0.0])


def off(times, force, goal, since_s):
    """Largest error of the force [N], from a time after the touch on."""
    touch = times[np.argmax(force > 1e-3)]
    return np.max(np.abs(force[times > touch + since_s] - goal))
