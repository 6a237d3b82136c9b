"""References given to the controller again and again, refused, or equal to what is in force."""

import control_samples
import numpy as np
import pytest

from soro_core import robot_from_dict
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.errors import ModelError
from tests.refused import refused

DT = 0.005
POSE = np.array([0.01, 0.004, -0.063])


@pytest.fixture(scope="module")
def control():
    robot = robot_from_dict({**control_samples.ROBOT, "links": [control_samples.LINK]})
    return Controller(robot, parse({"reference": {"kind": "hold", "start_s": 0.5}}, ControllerConfig, "test"))


def drive(control, seconds, hz=None, make=None, until=np.inf):
    """Commands by tick, to an arm that follows exactly, of what `make` gives at a rate (None: once)."""
    state, reference, given, rows = control.initial_state(), None, 0, []
    for k in range(round(seconds / DT)):
        t = k * DT
        due = given == 0 if hz is None else given <= t * hz
        if make is not None and due and t <= until:
            reference, given = make(state, t), given + 1
        q = np.zeros(3) if state.point is None else state.point.q
        state, command = control.step(state, q, np.zeros(3), t, DT, state.model_pa, reference)
        assert command.status.ok
        rows.append(command)
    return rows


def tip(control):
    return lambda state, t: control.tip(state, POSE)


def single(control):
    names = control.robot.coordinate_names
    return lambda state, t: control.trajectory(t, names, [2.0], [[0.05, 4.0, -6.0]])


def several(control):
    names = control.robot.coordinate_names
    rows = [[0.0, 0.0, 0.0], [0.05, 3.0, 0.0], [0.05, 4.0, -6.0]]
    return lambda state, t: control.trajectory(t, names, [0.0, 1.0, 2.0], rows)


@pytest.mark.slow
@pytest.mark.parametrize(("hz", "make"), [(1, single), (5, several), (20, single), (200, tip)])
def test_what_is_sent_repeatedly_ends_where_one_message_ends(control, hz, make):
    once, often = (drive(control, 4.0, rate, make(control)) for rate in (None, hz))
    for one, two in zip(once, often, strict=True):
        assert two.reference.q == pytest.approx(one.reference.q, abs=1e-7)
    assert often[-1].reference.qd == pytest.approx(np.zeros(3), abs=1e-9)
    assert often[-1].setpoint_pa == pytest.approx(once[-1].setpoint_pa, abs=1.0)


@pytest.mark.slow
def test_poses_that_differ_a_little_are_no_harm(control):
    """Of a hand or a camera, at 20 Hz: they stay within what was asked for."""
    rng = np.random.default_rng(1)
    rows = drive(control, 6.0, 20, lambda state, t: control.tip(state, POSE + 1e-4 * rng.standard_normal(3)))
    q = np.array([row.reference.q for row in rows[600:]])
    goal = control.tip(control.initial_state(), POSE).sample(0.0).q
    assert np.all(np.abs(q - goal) < [0.01, 0.3, 0.3])


@pytest.mark.slow
@pytest.mark.parametrize("hz", [5, 200])
def test_a_streamed_circle_is_followed_with_the_stated_lag(control, hz, figure):
    """12 mm in 6 s, one message and two time constants late; it stops where the stream stops."""

    def at(t):
        phase = 2 * np.pi * np.asarray(t) / 6.0
        return np.stack([0.012 * np.cos(phase), 0.012 * np.sin(phase), np.full_like(phase, -0.062)], axis=-1)

    rows = drive(control, 15.0, hz, lambda state, t: control.tip(state, at(t)), until=12.0)
    tips = np.array([row.tip_reference[:3, 3] for row in rows])
    t = np.arange(len(rows)) * DT
    steady = (t > 4.0) & (t < 12.0)
    lags = np.arange(0.0, 0.6, 0.001)
    errors = [np.sqrt(np.mean(np.sum((tips[steady] - at(t[steady] - x)) ** 2, axis=1))) for x in lags]
    lag, error = lags[np.argmin(errors)], min(errors)
    figure(
        f"stream at {hz} Hz: reference {1e3 * lag:.0f} ms late, then {1e3 * error:.2f} mm RMS from the circle"
    )
    assert lag == pytest.approx(1 / hz + 0.1, abs=0.01)
    assert error < 0.2e-3
    fastest = max(np.max(control.fields.peaks(row.reference.qd) / control.bounds.rate) for row in rows)
    assert fastest <= 1.0 + 1e-6
    assert tips[-1] == pytest.approx(at(12.0), abs=1e-6)
    assert rows[-1].reference.qd == pytest.approx(np.zeros(3), abs=1e-9)


def test_a_trajectory_runs_again_after_its_end_with_another_stamp_only(control):
    names = control.robot.coordinate_names

    def make(stamp):
        there_and_back = [[0.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 0.0]]
        return lambda state, t: control.trajectory(
            t, names, [0.0, 0.5, 1.0], there_and_back, stamp_ns=stamp(t)
        )

    same, other = (drive(control, 2.6, 2, make(stamp)) for stamp in (lambda t: 7, lambda t: round(t * 1e9)))
    for rows in (same, other):
        assert max(row.reference.q[1] for row in rows[:200]) > 2.0
    # It has come to rest, and then is there once more, or not.
    assert max(row.reference.q[1] for row in same[-200:]) < 1e-6
    assert max(row.reference.q[1] for row in other[-320:]) > 2.0


def test_what_was_ignored_does_not_come_later(control):
    """The same motion with another stamp, given while it runs, is not started when it has ended."""
    names, there_and_back = control.robot.coordinate_names, [[0.0] * 3, [0.0, 3.0, 0.0], [0.0] * 3]

    def make(state, t):
        return control.trajectory(t, names, [0.0, 0.5, 1.0], there_and_back, stamp_ns=round(t * 1e9))

    rows = drive(control, 3.0, 2, make, until=0.6)
    assert max(row.reference.q[1] for row in rows[:200]) > 2.0
    assert max(abs(row.reference.q[1]) for row in rows[220:]) < 1e-6


def test_a_trajectory_beyond_the_rates_is_refused_by_key(control):
    names = control.robot.coordinate_names
    with refused("rate of link0/bending_y", names=("31.25", "reference.bend_rate_rad_s")) as caught:
        control.trajectory(0.0, names, [0.0, 0.2], [[0.0, 0.0, 0.0], [0.0, 0.0, 10.0]])
    assert 70.0 < caught.value.got < 80.0
    with refused("rate of link0/elongation", names=("0.3", "reference.stretch_rate_per_s")):
        control.trajectory(0.0, names, [0.0, 0.2], [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]])


def test_a_trajectory_beyond_the_strains_between_its_points_is_refused(control):
    names = control.robot.coordinate_names
    with refused("positions of link0/bending_x", pytest.approx(61.0)):
        control.trajectory(
            0.0,
            names,
            [0.0, 2.0],
            [[0.0, 46.0, 0.0], [0.0, 46.0, 0.0]],
            [[0.0, 30.0, 0.0], [0.0, -30.0, 0.0]],
        )


def test_where_the_model_has_no_value_the_last_set_point_is_held(control, monkeypatch):
    state, zero = control.initial_state(), np.zeros(3)
    for k in range(100):
        state, before = control.step(state, zero, zero, k * DT, DT, state.model_pa)
    with monkeypatch.context() as patch:

        def broken(q):
            raise ModelError("an elongation is -1 or less")

        patch.setattr(control.arm, "actuation_matrix", broken)
        after, command = control.step(state, zero, zero, 0.5, DT, zero)
    assert after is state
    assert command.status.message == "no command: an elongation is -1 or less"
    assert command.setpoint_pa.tolist() == before.setpoint_pa.tolist()
    _, command = control.step(state, zero, zero, 0.505, DT, state.model_pa)
    assert command.status.ok


@pytest.mark.parametrize(
    ("reference", "key", "got"),
    [
        ({"kind": "set_point", "set_point": [0.7, 0.0, 0.0]}, "reference.set_point", 0.7),
        ({"curvature_per_m": 50.0, "choose_elongation": False}, "reference.curvature_per_m", 50.0),
    ],
)
def test_a_configured_reference_beyond_the_strains_is_refused_at_once(reference, key, got):
    robot = robot_from_dict({**control_samples.ROBOT, "links": [control_samples.LINK]})
    with refused(key, got):
        Controller(robot, parse({"reference": reference}, ControllerConfig, "test"))
