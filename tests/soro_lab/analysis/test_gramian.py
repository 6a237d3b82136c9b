"""Gramians against differences of simulated motions, and what each kind of sensor can say."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.errors import ModelError
from soro_core.estimation.config import EstimatorConfig
from soro_core.integrate.state import State
from soro_core.integrate.stepper import make_stepper
from soro_core.rotation import rotation_log
from soro_core.twin.config import TwinSection
from soro_lab.analysis.gramian import gramian, windows
from soro_lab.analysis.sensors import KINDS, SensorCandidate, SensorNoise, kinds_of, noise_of

DT, TICKS = 5e-3, 10


def noise(**keys):
    return SensorNoise(**(noise_of(TwinSection(), EstimatorConfig()) | keys))


def candidate(name, s, **keys):
    (kind,) = kinds_of((name,), noise(**keys), TwinSection())
    return SensorCandidate(kind, s)


@pytest.fixture(scope="module")
def moved():
    """Two links on the way down from a pressure, and what moves them."""
    arm = SoftArm(load_robot("asu_two_segment"))
    pressures = np.zeros((3 * TICKS, arm.n_u))
    pressures[0] = pressures[1] = 40e3, 0.0, 20e3, 0.0, 30e3, 0.0
    found = windows(arm, [pressures], DT, TICKS)
    return arm, pressures, found


def measured(name, arm, state, s, nominal):
    """What a sensor measures; rotations against those of a state near it, in the body frame.

    Angular velocities with the Jacobian of that state: as the filter, ours leave out how it changes with q.
    """
    pose = arm.pose(state.q, s)
    first, jacobian = arm.pose_and_jacobian(nominal.q, s)
    if name == "pose":
        turn = rotation_log(first[:3, :3].T @ pose[:3, :3])
        return np.concatenate([pose[:3, 3], turn])
    if name == "marker":
        return pose[:3, 3]
    turn = rotation_log(first[:3, :3].T @ pose[:3, :3])
    if name == "bend":
        return turn[:2]
    return np.concatenate([jacobian[:3] @ state.qd, turn, -pose[:3, :3].T @ arm.tables.gravity])


@pytest.mark.parametrize("name", KINDS)
def test_the_gramian_is_that_of_simulated_motions(moved, name, figure):
    """Simulated from states beside the start, 2.5 ms a step; sampled at each tick or at every second."""
    arm, pressures, found = moved
    n, s, window = arm.n_q, 0.2, found[-1]
    sensor = candidate(name, s)
    every = 1 if name == "imu" else 2
    stepper = make_stepper("trapezoidal", arm, guarded=False)
    begin = 2 * TICKS

    def outputs(q, qd):
        state, rows = State(q, qd, window.states[0].internal), []
        for k in range(TICKS + 1):
            if k % every == 0:
                rows.append(measured(name, arm, state, s, window.states[k]) / sensor.kind.std)
            if k < TICKS:
                for _ in range(2):
                    state, status = stepper.step(state, pressures[begin + k], 0.5 * DT)
                    assert status.ok
        return np.concatenate(rows)

    columns, q0, v0 = [], window.states[0].q, window.states[0].qd
    for i in range(2 * n):
        e = np.zeros(2 * n)
        # Damped velocities show little: with smaller steps the end of Newton's iteration shows more.
        e[i] = 1e-5 if i < n else 1e-2
        slope = outputs(q0 + e[:n], v0 + e[n:]) - outputs(q0 - e[:n], v0 - e[n:])
        columns.append(slope / (2.0 * e[i]))
    observability = np.stack(columns, axis=1)
    right = observability.T @ observability
    ours = gramian(arm, window, sensor, DT)[: 2 * n, : 2 * n]
    unit = np.sqrt(np.maximum(np.diag(right), 1e-9 * np.diag(right).max()))
    error = np.abs((ours - right) / np.outer(unit, unit)).max()
    figure(f"{name}: Gramian {error:.1e} from that of simulated motions")
    assert error < 1e-5


def test_an_unknown_acceleration_acts_as_pressures_that_make_it():
    """One link whose three chambers drive all three coordinates: H is square."""
    robot = load_robot("tue_three_bellow")
    (link,) = robot.links
    chambers = [chamber.model_copy(update={"area_slope": 0.0}) for chamber in link.chambers]
    arm = SoftArm(robot.replace(links=[link.model_copy(update={"chambers": tuple(chambers), "creep": ()})]))
    pressure = np.array([30e3, 0.0, 0.0])
    (window, *_) = windows(arm, [np.tile(pressure, (TICKS, 1))], DT, TICKS)
    q0 = window.states[0].q
    by_pressure = np.linalg.solve(arm.actuation_matrix(q0), arm.inertia_matrix(q0))
    stepper = make_stepper("trapezoidal", arm, guarded=False)
    for i in range(arm.n_q):
        size = 1e-2 * np.eye(arm.n_q)[i]
        ends = []
        for sign in (1.0, -1.0):
            state = State(q0, np.zeros(arm.n_q), np.zeros(0))
            for _ in range(2 * TICKS):
                state, _ = stepper.step(state, pressure + sign * by_pressure @ size, 0.5 * DT)
            ends.append(np.concatenate([state.q, state.qd]))
        right = (ends[0] - ends[1]) / (2 * size[i])
        ours = window.transitions[-1][:, 2 * arm.n_q + i]
        assert ours == pytest.approx(right, rel=2e-2, abs=1e-2 * np.abs(right).max())


@pytest.mark.parametrize("name", KINDS)
def test_a_sensor_at_the_base_says_nothing(moved, name):
    arm, _, found = moved
    for window in found:
        assert np.all(gramian(arm, window, candidate(name, 0.0), DT) == 0.0)
        assert np.trace(gramian(arm, window, candidate(name, 0.1), DT)) > 0.0


def test_twice_the_noise_is_a_quarter_of_the_information(moved):
    arm, _, (window, *_) = moved
    one, two = (gramian(arm, window, candidate("marker", 0.1, position_m=x), DT) for x in (1e-3, 2e-3))
    assert one == pytest.approx(4.0 * two)


def test_an_imu_does_not_see_a_stretch_that_does_not_turn_it(moved):
    """At rest and straight, elongation turns no section; a marker sees it."""
    arm = SoftArm(load_robot("asu_two_segment"))
    (window, *_) = windows(arm, [np.zeros((TICKS, arm.n_u))], DT, TICKS)
    stretch = [0, 3, arm.n_q, arm.n_q + 3]
    seen = gramian(arm, window, candidate("imu", arm.length), DT)
    assert np.abs(seen[np.ix_(stretch, stretch)]).max() < 1e-9 * np.trace(seen)
    seen = gramian(arm, window, candidate("marker", arm.length), DT)
    assert np.linalg.matrix_rank(seen[np.ix_(stretch[:2], stretch[:2])]) == 2


def test_motions_that_are_too_short_are_refused(moved):
    arm, pressures, _ = moved
    with pytest.raises(ModelError) as caught:
        windows(arm, [pressures[:3]], DT, TICKS)
    assert caught.value.key == "window"
