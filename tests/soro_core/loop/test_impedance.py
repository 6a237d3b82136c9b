"""The tip yields to a push as the factor on its own stiffness says, and comes back."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.adaptation.external_force import ExternalForce
from soro_core.config import with_changes
from soro_core.control.force.force_loop import ForceLoop
from soro_core.control.force.force_state import ForceLoopState
from soro_core.control.force.impedance import yielding
from soro_core.control.force.pushed_tip import PushedTip
from soro_core.control.force.tip_stiffness import StiffnessAtTip
from soro_core.control.motion_config import ForceControlConfig
from soro_core.twin import Twin
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of
from tests.refused import refused

# Whole runs of a loop.
pytestmark = pytest.mark.slow

PUSH_S, LEAVES_S, END_S = 6.0, 8.2, 10.2


class Held(Twin):
    """Its set points are held from the push on: it has the arm's own stiffness."""

    kept = None

    def step_setpoints(self, state, setpoint_pa):
        if self.kept is None or state.tick * self.dt < PUSH_S:
            self.kept = setpoint_pa
        return super().step_setpoints(state, self.kept)


def pushed(kind=Twin, push_n=(0.0, 0.02, 0.0), **force):
    """Return how far the push moves the tip, how far off it is at the end [m], the note, all tips."""
    keys = {
        "platform": "",
        "twin.payload_kg": 0.0,
        "twin.wrench": {"at_s": [PUSH_S, LEAVES_S], "force_n": [push_n, [0.0, 0.0, 0.0]], "change": "step"},
        "controller.reference": {"kind": "path", "start_s": 2, "path_m": [[0.01, 0.0, 0.066]]},
        "controller.force": force,
    }
    scene = load_scene("push_by_hand", keys)
    (loop, dt), twin = (loop_of(scene), 1.0 / scene.rate_hz), kind(scene.loaded_robot, scene.twin_node())
    ticks = list(loop.run(twin, round(END_S / dt), dt, before_s=-dt))
    tips = {
        at_s: np.mean([k.seen.tip[:3, 3] for k in ticks if at_s - 0.3 < k.t_s < at_s], axis=0)
        for at_s in (PUSH_S, LEAVES_S, END_S)
    }
    way, back = tips[LEAVES_S] - tips[PUSH_S], tips[END_S] - tips[PUSH_S]
    moves = np.array([k.seen.tip[:3, 3] for k in ticks if k.t_s > PUSH_S])
    return way @ push_n / np.linalg.norm(push_n), np.linalg.norm(back), ticks[-1].command.status.note, moves


@pytest.fixture(scope="module")
def own_m():
    return pushed(Held)[0]


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_the_tip_is_as_stiff_as_is_asked(own_m, factor, figure):
    way_m, off_m, note, _ = pushed(stiffness_factor=factor)
    figure(f"asked: {factor:g} of its own stiffness, found: {own_m / way_m:.2f}")
    assert own_m / way_m == pytest.approx(factor, rel=0.1)
    assert off_m < 2.5e-4
    assert not note


def test_a_load_is_held_up_as_before():
    """A soft tip that gave way to a load would fell the arm."""
    free, soft = (pushed(push_n=(0.0, 0.0, -0.2), **force)[3] for force in ({}, {"stiffness_factor": 0.5}))
    assert np.ptp(free[:, 2]) > 5e-3
    assert np.max(np.abs(soft - free)) < 1e-4


def test_an_arm_that_stands_by_its_feedback_alone_has_no_stiffness_to_multiply():
    """Its own compliance is negative: a softer tip would move against the push."""
    arm = SoftArm(load_robot("six_link"))
    config, still = ForceControlConfig(stiffness_factor=0.5), np.zeros(arm.n_q)
    push = PushedTip(StiffnessAtTip(arm), config, np.zeros((arm.n_q, arm.n_q)))
    felt = ExternalForce(np.array([0.02, 0.0, 0.0]), 1e-6 * np.eye(3), "contact")
    state = ForceLoopState(still, still, felt=felt, pressure_pa=np.zeros(arm.n_u))
    state, velocity = yielding(push, state, still, 0.005)
    assert not velocity.any()
    assert "stiffness_factor does nothing" in ForceLoop.note(state)


def test_a_stiffness_that_the_loop_cannot_reach_is_refused():
    for factor in (0.4, 2.5, -1.0):
        with refused("stiffness_factor", got=factor):
            with_changes(ForceControlConfig(), stiffness_factor=factor)
