"""The simulated world: at rest where it should be, as heavy as it should be, the same twice."""

import numpy as np
import pytest
import yaml

from soro_core import load_robot
from soro_core.config import find_config, parse
from soro_core.errors import ConfigError
from soro_core.twin import SensorConfig, Twin, TwinConfig
from soro_core.twin.plant import true_robot
from tests.collapsing_arm import collapsing_arm
from tests.refused import refused

PRESSURE = np.array([10e3, 20e3, 15e3])


@pytest.fixture(scope="module")
def robot():
    return load_robot(find_config("tue_three_bellow", "robots"))


def test_the_plant_is_finer_and_carries_the_payload(robot):
    real = true_robot(robot, TwinConfig(refine=4, payload_kg=0.02))
    assert len(real.links) == 4
    assert real.tip_mass == pytest.approx(robot.tip_mass + 0.02)
    assert sum(link.length for link in real.links) == pytest.approx(robot.length)
    assert real.n_u == robot.n_u


def test_rest_is_an_equilibrium_that_the_stepper_keeps(robot):
    twin = Twin(robot, TwinConfig(payload_kg=0.02))
    state = twin.initial(PRESSURE)
    arm = twin.plant.arm
    q = state.arm.q
    force = arm.gravity_force(q) + arm.elastic_force(q) - arm.actuation_matrix(q) @ PRESSURE
    assert np.abs(force / (1.0 + np.abs(arm.elastic_force(q)))).max() < 1e-6
    for _ in range(50):
        state = twin.step_pressures(state, PRESSURE)
    assert state.arm.q == pytest.approx(q, rel=1e-4, abs=1e-5)


def test_a_step_of_pressure_settles_in_its_equilibrium(robot):
    twin = Twin(robot, TwinConfig(payload_kg=0.02))
    state = twin.initial()
    for _ in range(800):
        state = twin.step_pressures(state, PRESSURE)
    assert state.status.ok
    wanted = twin.plant.rest(PRESSURE).q
    tip = twin.plant.arm.pose(state.arm.q, twin.length)[:3, 3]
    assert tip == pytest.approx(twin.plant.arm.pose(wanted, twin.length)[:3, 3], abs=2e-4)


def test_a_link_that_collapses_stops_the_plant_with_its_cause():
    """An arm of softer bending than its file: what the file allows bends it short."""
    twin = Twin(collapsing_arm(), TwinConfig(gain_scale=2.2, refine=1))
    pressure = np.array([105e3, 0.0, 0.0, 0.0, 0.0, 0.0])
    state = twin.initial()
    for _ in range(2000):
        before, state = state, twin.step_pressures(state, pressure)
        if not state.status.ok:
            break
    assert "link0" in state.status
    assert "compressed to nothing" in state.status
    assert state.arm.q[0] > -0.991
    assert state.arm.q == pytest.approx(before.arm.q, rel=0.02, abs=0.01)
    again = twin.step_pressures(state, pressure)
    assert again.status == state.status
    assert again.arm is state.arm


def run(robot, seed: int, imu: bool = False, places: tuple[float, ...] = (1.0,)) -> list[np.ndarray]:
    """Readings, and poses of the sensor at the tip."""
    pose, imus = SensorConfig(locations=places), SensorConfig(enabled=imu, rate_hz=200.0)
    config = TwinConfig(seed=seed, payload_kg=0.02, pose=pose, imu=imus)
    twin = Twin(robot, config)
    state = twin.initial()
    rows = []
    for k in range(60):
        state, seen = twin.observe(state)
        at_tip = (p.position for p in seen.poses if p.s == twin.length)
        rows.append(np.concatenate([seen.reading_pa, seen.tip.ravel(), *at_tip]))
        state = twin.step_setpoints(state, PRESSURE * (1 + 0.1 * np.sin(k)))
    return rows


def test_the_same_seed_gives_the_same_bits_and_another_one_does_not(robot):
    first, again, other = run(robot, 3), run(robot, 3), run(robot, 4)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[10], other[10])


def test_a_further_sensor_does_not_change_what_the_others_measure(robot):
    without = run(robot, 3)
    for more in (run(robot, 3, imu=True), run(robot, 3, places=(1.0, 0.5))):
        assert all(np.array_equal(a, b) for a, b in zip(more, without, strict=True))


def test_poses_come_from_each_place_of_its_own_noise(robot):
    places = (1.0, 0.25, 0.5)
    twin = Twin(robot, TwinConfig(pose=SensorConfig(rate_hz=200.0, delay_s=0.0, locations=places)))
    state, seen = twin.observe(twin.initial(PRESSURE))
    assert [pose.s for pose in seen.poses] == [place * twin.length for place in places]
    truth = [twin.plant.arm.pose(state.arm.q, pose.s)[:3, 3] for pose in seen.poses]
    errors = np.array([pose.position for pose in seen.poses]) - truth
    assert 1e-5 < np.abs(errors).max() < 2e-3
    assert np.diff(np.sort(errors, axis=None)).min() > 1e-9


def test_imus_feel_what_their_own_place_does_with_noise_of_their_own(robot):
    """At rest: up, in the frame of a bent arm there."""
    places = (1.0, 0.25, 0.5)
    config = SensorConfig(enabled=True, rate_hz=200.0, delay_s=0.0, locations=places)
    twin = Twin(robot, TwinConfig(imu=config))
    state, seen = twin.observe(twin.initial(PRESSURE))
    assert [imu.s for imu in seen.imus] == [place * twin.length for place in places]
    up = -np.array(robot.gravity)
    truth = np.array([twin.plant.arm.pose(state.arm.q, imu.s)[:3, :3].T @ up for imu in seen.imus])
    assert np.linalg.norm(truth[0] - truth[2]) > 0.6
    errors = np.array([imu.linear_acceleration for imu in seen.imus]) - truth
    assert 1e-4 < np.abs(errors).max() < 0.3
    assert np.diff(np.sort(errors, axis=None)).min() > 1e-9


def test_one_place_can_be_called_location():
    assert parse({"location": 0.5}, SensorConfig, "test") == SensorConfig(locations=(0.5,))


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        ({"locations": [1.0, 1.2]}, "locations"),
        ({"locations": [0.5, 0.5]}, "locations"),
        ({"locations": []}, "locations"),
        ({"locations": [1.0], "location": 0.5}, ""),
    ],
)
def test_places_that_cannot_be_are_refused(keys, key):
    with refused(key):
        parse(keys, SensorConfig, "test")


def test_the_plant_can_be_another_robot(tmp_path):
    known = load_robot("tue_three_bellow")
    softer = known.scaled(stiffness=0.5, damping=1.0, gain=1.0).model_dump(mode="json", exclude_unset=True)
    path = tmp_path / "softer.yaml"
    path.write_text(yaml.safe_dump(softer), encoding="utf-8")
    config = TwinConfig(plant=str(path), refine=1)
    assert true_robot(known, config).links[0].k_b[0] == pytest.approx(0.5 * known.links[0].k_b[0])
    pressure = np.array([5e3, 0.0, 0.0])
    bent = [Twin(known, c).initial(pressure).arm.q[1] for c in (config, TwinConfig(refine=1))]
    assert abs(bent[0]) > 1.5 * abs(bent[1])


def test_a_plant_with_other_chambers_is_refused():
    with pytest.raises(ConfigError) as caught:
        Twin(load_robot("tue_three_bellow"), TwinConfig(plant="asu_two_segment"))
    assert caught.value.key == "links"
    assert "link1/chamber0" in caught.value.got
