"""What the watch over the sensors names: a delay that is not declared, a residual that grows."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.config import find_config, parse
from soro_core.control import ControllerConfig
from soro_core.estimation import EstimatorConfig
from soro_core.estimation.sensors.delay import DelayModel
from soro_core.estimation.sensors.delay_monitor import PERIOD_S, DelayMonitor, Delays, mean_pressure
from soro_core.estimation.sensors.monitor import Innovation, monitored
from soro_core.estimation.sensors.samples import pose_sensor
from soro_core.estimation.sensors.watch_config import WatchConfig
from soro_core.loop import Loop
from soro_core.pneumatics import RegulatorModel
from tests.soro_core.estimation.test_learned_force import DT, LENGTH, Run, learned
from tests.soro_core.loop.loop_harness import Controller, Estimator, Harness, Setup

SENSOR = pose_sensor(LENGTH)
CONFIG = WatchConfig()


class Shifted(Harness):
    """Poses are stamped later than they were taken, from a time on."""

    shift_s, from_s = 0.0, 0.0

    def observe(self, world):
        t = world.tick * self.setup.dt
        world, seen = super().observe(world)
        shift = self.shift_s if t >= self.from_s else 0.0
        late = tuple(replace(pose, stamp_s=pose.stamp_s + shift) for pose in seen.poses)
        return world, replace(seen, poses=late)


def notes_of(duration_s, shift_s=0.0, from_s=0.0, law="composite", **changes):
    """Notes of the estimator in closed loop with 20 g, and the last fit of the delay."""
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    control = parse({"law": law}, ControllerConfig, "test")
    setup = Setup(control=control, **changes)
    plant = Shifted(robot, setup)
    plant.shift_s, plant.from_s = shift_s, from_s
    loop = Loop(Estimator(robot, setup.estimation, setup.dt), Controller(robot, control))
    monitor, delays = DelayMonitor(loop.estimator.arm, loop.estimator.config), Delays()
    notes, passed, looks = [], [], 0
    step = loop.estimator.step

    def watched(*arguments):
        state, estimate = step(*arguments)
        passed.append(state)
        return state, estimate

    loop.estimator.step = watched
    for tick in loop.run(plant, round(duration_s / setup.dt), setup.dt, delay=0):
        assert tick.estimate.status.ok or tick.t_s < 0.1
        if tick.t_s >= looks * PERIOD_S - 1e-9:  # beside the loop
            delays, looks = monitor.step(delays, passed), looks + 1
            passed.clear()
        found = "; ".join(filter(None, (tick.estimate.status.note, monitor.note(delays))))
        notes.append((tick.t_s, found))
    return [(t, note) for t, note in notes if note], delays.fits[SENSOR]


def fit_of(run, ticks, monitor):
    """Fits of the delay after some ticks with a learned force."""
    passed = []
    for _ in range(ticks):
        run.tick(model=learned())
        passed.append(run.state)
    return monitor.step(Delays(), passed)


def test_looks_at_one_tick_or_at_many_find_the_same():
    run = Run()
    monitor, passed = DelayMonitor(run.estimator.arm, run.estimator.config), []
    for _ in range(200):
        run.tick(model=learned())
        passed.append(run.state)
    alone, kept = Delays(), passed.copy()
    for state in passed:
        alone = monitor.step(alone, [state])
    at_once = monitor.step(Delays(), passed)
    assert passed == kept
    assert at_once.last is alone.last is passed[-1]
    assert at_once.fits[SENSOR].solution.tobytes() == alone.fits[SENSOR].solution.tobytes()
    # Rows come with poses only: silent ticks change nothing.
    silent = [passed[-1]._replace(t_s=passed[-1].t_s + k * DT) for k in range(1, 50)]
    assert monitor.step(at_once, silent).fits == at_once.fits
    assert monitor.step(at_once, []) is at_once


@pytest.mark.parametrize("seed", [1, 2])
def test_a_delay_that_begins_is_named_within_two_seconds(seed):
    notes, fit = notes_of(7.0, 0.02, from_s=4.0, seed=seed)
    first_s, note = notes[0]
    print(f"named {first_s - 4.0:.2f} s after it begins: {note}; in the end {1e3 * fit.delay_s:.1f} ms")
    assert 0.0 <= first_s - 4.0 <= 2.0
    assert SENSOR in note
    assert fit.delay_s == pytest.approx(0.02, abs=0.007)
    assert f"{1e3 * fit.delay_s:.0f} ms" in notes[-1][1]


@pytest.mark.parametrize(("law", "seed"), [("composite", 1), ("composite", 16), ("adaptive", 1)])
def test_a_delay_from_the_start_is_named_within_two_seconds(law, seed):
    """Once the fit separates load and delay; a law without a learned force shows it too."""
    notes, _ = notes_of(2.5, 0.02, law=law, seed=seed)
    print(f"named after {notes[0][0]:.2f} s: {notes[0][1]}")
    assert notes[0][0] <= 2.0
    assert SENSOR in notes[0][1]


@pytest.mark.parametrize(
    ("law", "changes"),
    [("composite", {"payload_kg": 0.035, "seed": 3}), ("adaptive", {"payload_kg": 0.03, "seed": 2})],
)
def test_a_heavy_load_is_no_delay(law, changes):
    notes, _ = notes_of(3.0, law=law, **changes)
    assert not any("stamps" in note for _, note in notes)


@pytest.mark.slow
def test_good_sensors_give_no_note():
    """Neither a load, nor lag, outliers and lost poses look like a delay or a residual that grows."""
    lag = RegulatorModel(tau_s=0.104)
    notes, fit = notes_of(12.0, regulator=lag, outlier=0.02, drop=0.2)
    print(f"{1e3 * fit.delay_s:.1f} +- {1e3 * fit.deviation_s:.1f} ms")
    assert notes == []
    assert abs(fit.delay_s) < 0.005


def test_a_load_that_falls_off_and_less_damping_are_no_delay():
    notes, fit = notes_of(4.0, load_steps=((3.0, 0.0),), damping=0.7)
    # Outliers of the step can begin the fit anew.
    assert fit.delay_s < CONFIG.delay_allowed_s
    assert not any("stamps" in note for _, note in notes)


def test_no_delay_is_estimated_where_a_position_does_not_show_all_coordinates():
    link = load_robot(find_config("tue_three_bellow", "robots"))
    two = link.replace(links=(link.links[0], link.links[0]), name="two_links")
    assert DelayModel(SoftArm(link), EstimatorConfig()).usable
    assert not DelayModel(SoftArm(two), EstimatorConfig()).usable


def test_a_state_beyond_the_model_ends_the_fit_and_raises_nothing():
    """Ahead of it the arm would be shorter than nothing."""
    run = Run()
    monitor = DelayMonitor(run.estimator.arm, run.estimator.config)
    delays = fit_of(run, 200, monitor)
    belief = run.state.belief
    mean = belief.mean.copy()
    mean[belief.n] = -200.0
    run.tick(model=learned())
    run.tick(model=learned())  # with a pose
    state = run.state._replace(belief=belief._replace(mean=mean), t_s=run.state.t_s + 0.1)
    assert delays.fits[SENSOR].solution.any()
    assert not monitor.step(delays, [state]).fits[SENSOR].solution.any()


def test_the_pressures_of_a_row_are_their_mean_since_the_last_one():
    run = Run()
    run.ticks(20)
    history, latest = run.state.history, run.state.pressure_pa
    since_s = history[-1].end_s - 4 * DT
    of_steps = np.array([part.pressure_pa for part in history[-4:]])
    np.testing.assert_allclose(mean_pressure(history, since_s, latest), of_steps.mean(axis=0), rtol=1e-12)
    half = (*history[:-1], history[-1]._replace(end_s=history[-1].start_s + 0.5 * DT))
    weights = np.array([1.0, 1.0, 1.0, 0.5])
    expected = weights @ of_steps / weights.sum()
    np.testing.assert_allclose(mean_pressure(half, since_s, latest), expected, rtol=1e-12)
    assert mean_pressure(history, history[-1].end_s, latest) is latest


def test_a_residual_that_grows_is_named_within_two_seconds():
    run = Run()
    model = learned()
    for _ in range(400):
        assert run.tick(model=model)[0].status.note == ""
    run.noise_m *= 3.0
    silent = 0
    while run.tick(model=model)[0].status.note == "":
        silent += 1
        assert silent * DT <= 2.0
    estimate, _ = run.tick(model=model)
    monitor = run.state.monitors[SENSOR]
    assert monitor.watched > monitor.allowed(CONFIG)
    assert estimate.status.ok
    assert SENSOR in estimate.status.note
    assert f"{monitor.watched:.1f}" in estimate.status.note
    # It goes when the sensor is good again.
    run.noise_m /= 3.0
    estimate, _ = run.ticks(800, model=model)
    assert estimate.status.note == ""


def test_the_delay_of_an_arm_at_rest_is_not_known():
    run = Run(moving=False)
    fit = fit_of(run, 600, DelayMonitor(run.estimator.arm, run.estimator.config)).fits[SENSOR]
    assert fit.deviation_s > 0.05
    assert abs(fit.delay_s) < fit.deviation_s


@pytest.mark.parametrize(("information", "is_late"), [(20.0, False), (1e4, True)])
def test_a_delay_of_which_the_rows_say_little_is_not_named(information, is_late):
    """`information` [1/s^2] of the rows beside 100 of the prior: 20 leave a deviation of 91 ms."""
    config = EstimatorConfig()
    model = DelayModel(SoftArm(load_robot("tue_three_bellow")), config)
    row = np.sqrt(information * model._noise * config.watch.delay_correlation_s / config.watch.delay_time_s)
    regressor, delay_s = np.zeros((3, 6)), 0.021 * (100.0 + information) / information
    regressor[0, 0] = row
    fit = model.start(0.0)
    for k in range(1, 100):
        fit = model._fitted(fit, regressor, np.array([row * delay_s, 0.0, 0.0]), 0.1 * k)
    assert fit.delay_s == pytest.approx(0.021, rel=0.01)
    assert fit.deviation_s == pytest.approx((100.0 + information) ** -0.5, rel=0.01)
    assert fit.is_late == is_late


def test_a_sensor_that_is_silent_is_not_judged():
    run = Run(noise_m=1.5e-3)
    estimate, _ = run.ticks(400)
    assert SENSOR in estimate.status.note
    estimate, _ = run.ticks(60, pose=False)
    assert SENSOR not in estimate.status.note


def watched(values, dt=0.01, config=CONFIG):
    state = None
    for k, value in enumerate(values):
        state = monitored(state, Innovation(SENSOR, k * dt, value, value), dt, config)
    return state


def test_the_mean_follows_its_time_constant_and_one_outlier_counts_little():
    state = watched(np.concatenate([np.full(1000, 3.0), np.full(100, 5.0)]))
    assert state.position_nis == pytest.approx(5.0 - 2.0 * np.exp(-1.0), rel=1e-6)
    assert 1.0 / state.squares == pytest.approx(2.0 / 0.01, rel=0.01)
    outlier = watched([*np.full(1000, 3.0), 1e6])
    assert outlier.position_nis < outlier.allowed(CONFIG)


@pytest.mark.parametrize("probability", [0.1, 0.01])
def test_a_good_sensor_exceeds_the_bound_with_the_stated_probability(probability):
    config = WatchConfig(nis_false_alarm=probability, nis_time_s=0.1)
    drawn = np.random.default_rng(7).chisquare(3, (1500, 60))
    above = np.mean(
        [state.watched > state.allowed(config) for state in (watched(row, config=config) for row in drawn)]
    )
    print(f"{above:.4f} of good sensors above the bound of {probability}")
    # The largest 1 % count less than they are, so that the rate lies below; four deviations of the draw.
    assert above <= probability + 4.0 * np.sqrt(probability / len(drawn))
    assert above > 0.1 * probability
