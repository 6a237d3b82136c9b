"""An arm presses on a wall of the twin that estimator and controller do not know."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core.adaptation.external_force import ExternalForce
from soro_core.config import with_changes
from soro_core.control.force.press import Press
from soro_core.control.force.pressing import pressed
from soro_core.control.force.tracked_tip import Track, tracked
from soro_core.twin import Twin
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of
from tests.refused import refused

# Whole runs of a loop.
pytestmark = pytest.mark.slow

RADIUS_M, BEGIN_S = 0.013, 7.0
# Where the tip meets the wall.
PLACE = np.array([0.012, 0.0, 0.068])


def scene_with(
    tilt_deg=0.0, stiffness=2000.0, friction=0.3, moves_m_s=0.0, span_s=(2.0, 3.0), platform="", **force
):
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
        "from_s": BEGIN_S + span_s[0],
        "to_s": BEGIN_S + span_s[1],
    }
    keys = {
        "platform": platform,
        "twin.payload_kg": 0.0,
        "twin.wall": wall,
        "controller.reference": {"curvature_per_m": 4.0, "start_s": 2.0},
        "controller.force": {"approach_speed_m_s": 0.01, **force},
    }
    return load_scene("track_circle", keys)


def run(scene, seconds, wanted, kind=Twin):
    """Times since the begin [s], force on the wall along x [N], tips, and the last tick.

    `wanted(controller, state)` gives the reference from the begin on; before, the arm circles, then rests
    3 mm from the wall.
    """
    loop, dt, made = loop_of(scene), 1.0 / scene.rate_hz, []

    def reference(t, inner):
        if t < 4.0 or wanted is None:
            return None
        if not made:
            made.append(loop.controller.tip(inner.controller, PLACE - np.array([0.003, 0.0, 0.0])))
        if t > BEGIN_S and len(made) == 1:
            made.append(wanted(loop.controller, inner.controller))
        return made[-1]

    twin = kind(scene.loaded_robot, scene.twin_node())
    ticks = list(loop.run(twin, round((BEGIN_S + seconds) / dt), dt, reference=reference, before_s=-dt))
    rows = np.array([(tick.t_s - BEGIN_S, -tick.seen.contact_n[0]) for tick in ticks if tick.t_s >= BEGIN_S])
    assert all(tick.command.status.ok for tick in ticks[5:])
    tips = np.array([tick.seen.tip[:3, 3] for tick in ticks if tick.t_s >= BEGIN_S])
    return *rows.T, tips, ticks[-1]


def pressing(newton):
    return lambda controller, state: controller.press(state, [newton, 0.0, 0.0])


def behind(controller, state):
    return controller.tip(state, PLACE + np.array([0.008, 0.0, 0.0]))


def off(times, force, goal, since_s):
    """Largest error of the force [N], from a time after the touch on."""
    touch = times[np.argmax(force > 1e-3)]
    return np.max(np.abs(force[times > touch + since_s] - goal))


@pytest.mark.parametrize(
    ("goal", "keys"),
    [
        (0.05, {}),
        (0.05, {"stiffness": 200.0, "friction": 0.8}),
    ],
)
def test_a_press_is_near_its_force_soon_after_the_touch(goal, keys):
    times, force, _, _ = run(scene_with(**keys), 4.0, pressing(goal))
    assert off(times, force, goal, 1.2) < 0.1 * goal
    assert off(times, force, goal, 2.0) < 3e-3  # the noise of the estimated force is 9 mN
    settled = force[times > times[np.argmax(force > 1e-3)] + 2.0]
    assert np.std(settled) < 0.65e-3, "the reference of a tip that rests moves by the noise of its positions"
    assert np.max(force) < goal + max(0.1 * goal, 3e-3)


@pytest.mark.parametrize(
    ("goal", "part", "approach_s", "is_measured", "phase"),
    [
        (0.05, 0.2, 1.0, True, "contact"),
        (0.05, 1.0, 1.0, True, "approach"),
        (0.05, 0.2, 0.3, True, "approach"),  # it has not begun to move
        (0.05, 0.2, 1.0, False, "approach"),
        (0.02, 1.0, 1.0, True, "approach"),  # in free air the estimate may be off by so much
        (0.02, 0.2, 1.0, True, "contact"),
        (0.02, 1.0, 1.0, False, "contact"),
    ],
)
def test_a_tip_that_is_stopped_touches_with_less_force(goal, part, approach_s, is_measured, phase):
    loop, here, x = loop_of(scene_with()).controller.force_loop, np.zeros(3), np.array([1.0, 0.0, 0.0])
    press = Press(np.zeros(loop.arm.n_q), x, goal, np.zeros(3))
    felt = ExternalForce(-8e-3 * x, 1e-6 * np.eye(3), tip=here if is_measured else None)
    speed = part * loop.config.approach_speed_m_s * x
    at = tracked(None, Track(here, speed), None, False, 0.0)
    told = {"press": press, "felt": felt, "phase": "approach", "tracked": at}
    state = replace(loop.initial_state(), approach_s=approach_s, **told)
    assert pressed(loop._push, state, press, here, 0.005).phase == phase


def test_a_press_follows_a_wall_that_moves():
    span_s = 1.0, 2.1
    times, force, _, _ = run(scene_with(moves_m_s=-0.01, span_s=span_s), 3.6, pressing(0.05))
    error = np.abs(force - 0.05)
    assert np.max(error[(times > span_s[0] + 0.7) & (times < span_s[1])]) < 4.5e-3
    assert np.max(error[times > span_s[1] + 1.0]) < 4.5e-3


def test_a_cap_leaves_the_arm_that_gets_a_load_as_it_is():
    rest, tips = PLACE - np.array([0.003, 0.0, 0.0]), []
    for cap_n in (0.0, 0.1):  # given way to, 30 g fell the arm
        scene = scene_with(cap_n=cap_n)
        far = with_changes(scene.twin.wall, point=(0.5, 0.0, 0.0))
        load = {"at_s": [BEGIN_S + 0.2], "force_n": [[0.0, 0.0, -0.294]]}
        scene = with_changes(scene, twin=with_changes(scene.twin, wall=far, wrench=load))
        tips.append(run(scene, 0.8, lambda controller, state: controller.tip(state, rest))[2])
    assert np.ptp(tips[0][:, 2]) > 5e-3
    assert np.max(np.abs(tips[1] - tips[0])) < 1e-4


def test_the_cap_bounds_the_force_of_a_reference_behind_the_wall():
    free = run(scene_with(), 3.0, behind)[1]
    times, force, _, _ = run(scene_with(cap_n=0.04), 3.0, behind)
    touch = times[np.argmax(force > 1e-3)]
    mean = np.convolve(force, np.full(10, 0.1), mode="valid")  # of 50 ms
    assert np.max(free) > 0.055
    assert np.max(mean[times[9:] > touch + 0.3]) < 0.043


def test_a_tip_that_meets_nothing_stops():
    def away(controller, state):
        return controller.press(state, [-0.05, 0.0, 0.0])

    _, force, _, last = run(scene_with(approach_s=1.0), 2.0, away)
    assert not force.any()
    assert "no contact within 1.0 s" in last.command.status.note
    assert last.command.tip_reference[0, 3] == pytest.approx(PLACE[0] - 0.003 - 0.01, abs=2e-4)


def test_a_tip_that_pressures_take_no_further_names_the_chamber():
    """The wall is out of reach: the approach ends at the limit of a chamber."""
    scene = scene_with(approach_s=10.0, approach_speed_m_s=0.03)
    far = with_changes(scene.twin.wall, point=(0.5, 0.0, 0.0))
    scene = with_changes(scene, twin=with_changes(scene.twin, wall=far))
    note = run(scene, 3.0, pressing(0.05))[3].command.status.note
    assert "no contact where the tip follows (link0/chamber" in note
    assert "kPa more than its limit" in note


def test_forces_that_pressures_cannot_make_and_caps_below_the_friction_are_refused():
    scene = scene_with(platform="emulated_canopen")
    loop, dt = loop_of(scene), 1.0 / scene.rate_hz
    twin = Twin(scene.loaded_robot, scene.twin_node())
    state = loop.initial_state(-dt)
    with refused("force", got="no estimate of it"):
        loop.controller.press(state.controller, [0.1, 0.0, 0.0])
    plant = twin.initial()
    for _ in range(40):
        plant, seen = twin.observe(plant)
        state, _, command = loop.step(state, seen.reading_pa, seen.poses, seen.imus, dt)
        plant = twin.step_setpoints(plant, command.setpoint_pa)
    with refused("force", names=("link0/chamber", "kPa")):
        loop.controller.press(state.controller, [3.0, 0.0, 0.0])
    with refused("force", got="200 mN", names=("link0/chamber", "kPa")):
        # The differences of pressure fit into the range, but not at the length that all of them make.
        loop.controller.press(state.controller, [0.2, 0.0, 0.0])
    with refused("force", names=("finite", "1000 N")):
        loop.controller.press(state.controller, [1e200, 0.0, 0.0])  # whose square is infinite
    with refused("force", got="1 mN", names=("friction",)):
        loop.controller.press(state.controller, [1e-3, 0.0, 0.0])
    assert isinstance(loop.controller.press(state.controller, [0.1, 0.0, 0.0]), Press)
    capped = loop_of(scene_with(platform="emulated_canopen", cap_n=1e-4)).controller
    with refused("force.cap_n", names=("friction",)):
        capped.press(state.controller, [0.05, 0.0, 0.0])


class Blind(Twin):
    """No poses are seen for 0.6 s."""

    blind_s = (BEGIN_S + 2.5, BEGIN_S + 3.1)

    def observe(self, state):
        state, seen = super().observe(state)
        low, high = self.blind_s
        return state, replace(seen, poses=()) if low < state.tick * self.dt < high else seen


@pytest.mark.parametrize(
    "wanted", [pytest.param(pressing(0.05), id="a reference"), pytest.param(None, id="configured")]
)
def test_a_press_whose_force_is_no_longer_estimated_stops_where_it_was(wanted):
    scene = scene_with()
    if wanted is None:
        reference = {
            "kind": "path",
            "path_m": [0.009, 0.0, 0.068],
            "press_n": [0.05, 0, 0],
            "press_s": BEGIN_S,
        }
        scene = with_changes(scene, controller=with_changes(scene.controller, reference=reference))
    times, force, tips, last = run(scene, 3.6, wanted, Blind)
    sees_s = Blind.blind_s[0] - BEGIN_S
    before, after = times < sees_s, times > sees_s + 0.25
    assert np.mean(force[before][-50:]) > 0.03
    assert np.max(force[after]) < 0.06
    assert np.max(np.linalg.norm(tips[after] - np.mean(tips[before][-50:], axis=0), axis=1)) < 2.5e-3
    assert "no estimate of the force" in last.command.status.note


def test_the_cap_bounds_again_after_some_time_without_an_estimate():
    times, force, _, _ = run(scene_with(cap_n=0.04), 4.6, behind, Blind)
    blind_s, sees_s = (t - BEGIN_S for t in Blind.blind_s)
    assert np.max(force[(times > blind_s + 0.3) & (times < sees_s)]) < 0.043
    assert np.max(force[times > sees_s]) < 0.1
    assert np.max(force[times > sees_s + 1.2]) < 0.045


def test_an_arm_whose_configured_press_cannot_be_stays_on_its_reference_and_says_why():
    scene = scene_with(platform="emulated_canopen")
    reference = with_changes(scene.controller.reference, press_n=(3.0, 0.0, 0.0), press_s=BEGIN_S)
    scene = with_changes(scene, controller=with_changes(scene.controller, reference=reference))
    _, force, tips, last = run(scene, 1.0, None)
    assert "press: force" in last.command.status.note
    assert "kPa" in last.command.status.note
    assert not force.any()
    assert np.linalg.norm(tips[-1] - last.command.tip_reference[:3, 3]) < 1e-3


def test_a_cap_without_an_estimate_of_the_force_says_so():
    scene = scene_with(cap_n=0.04)
    scene = with_changes(scene, estimator=with_changes(scene.estimator, force={"enabled": False}))
    last = run(scene, 0.1, None)[3]
    assert "no estimate of the force: nothing keeps it below the cap" in last.command.status.note
