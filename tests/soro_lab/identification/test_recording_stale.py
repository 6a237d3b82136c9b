"""Repeated and frozen readings, and equal readings that are neither."""

import numpy as np
import pytest
from made_recordings import CHAMBERS, robot, write_csv

from soro_core.config import parse
from soro_lab.identification.recording import Columns, StaleLimits, read_csv

PRESSURES = {"columns": {CHAMBERS[0]: "pa", CHAMBERS[1]: "pb"}}
COMMANDS = {"columns": {CHAMBERS[0]: "ca", CHAMBERS[1]: "cb"}}
T = np.arange(0.0, 20.0, 0.05)


def table(noise_pa: float = 200.0) -> dict[str, np.ndarray]:
    """Steps of 20 kPa every 5 s, first order, in readings of 10 Pa, and a tip that follows; noise."""
    rng = np.random.default_rng(1)
    command = 20e3 * (np.floor(T / 5.0) % 2)
    pressure, tip = np.zeros(len(T)), np.zeros(len(T))
    for k in range(1, len(T)):
        pressure[k] = pressure[k - 1] + 0.3 * (command[k - 1] - pressure[k - 1])
        tip[k] = tip[k - 1] + 0.5 * (1e-6 * pressure[k - 1] - tip[k - 1])
    pa, pb = (np.round(pressure + noise_pa * rng.standard_normal(len(T)), -1) for _ in range(2))
    x = tip + 1e-4 * rng.standard_normal(len(T))
    still = np.zeros(len(T))
    return {"t": T, "ca": command, "cb": command, "pa": pa, "pb": pb, "x": x, "y": still, "z": still}


def read(tmp_path, columns, with_commands=True, **limits):
    chosen = {"pressures": PRESSURES, "markers": {"tip": {"link": 1, "position": ["x", "y", "z"]}}}
    chosen |= {"commands": COMMANDS} if with_commands else {}
    file = write_csv(tmp_path / "run.csv", columns)
    stale = StaleLimits(**limits) if limits else None
    found = read_csv(file, parse(chosen, Columns, where="map"), robot(), stale)
    return found, {each.stream: each for each in found.faults}


def between(start, end):
    return (start <= T) & (end > T)


def test_readings_that_a_logger_repeats_count_once(tmp_path):
    """Each stream by itself; set points stand still by nature."""
    columns = table()
    columns["ca"] = columns["cb"] = 1e3 * np.floor(T / 0.5)
    for name, every in (("pa", 2), ("pb", 2), ("x", 3)):
        columns[name] = np.repeat(columns[name][::every], every)[: len(T)]
    found, faults = read(tmp_path, columns)
    np.testing.assert_array_equal(found.pressure.t, T[::2])
    np.testing.assert_array_equal(found.markers[0].t, T[::3])
    assert faults["pressure"].repeated == len(T) - len(T[::2])
    assert (faults["command"].left_out, len(found.command.t)) == (0, len(T))
    assert not any(each.frozen for each in found.faults)


@pytest.mark.parametrize("with_commands", [True, False])
def test_pressures_that_flickered_and_stop_are_frozen(tmp_path, with_commands):
    """At rest, with no set point that moves: the noise of a sensor does not stop while others go on."""
    columns = table()
    rows = between(12.0, 14.5)
    for name in ("pa", "pb"):
        columns[name][rows] = columns[name][rows][0]
    found, faults = read(tmp_path, columns, with_commands)
    assert faults["pressure"].frozen == (pytest.approx((12.0, 14.45)),)
    assert faults["pressure"].frozen_samples == rows.sum() - 1
    assert not between(12.01, 14.5)[np.isin(T, found.pressure.t)].any()
    assert faults["tip"].left_out == 0


def test_one_chamber_alone_is_frozen_if_its_set_point_moves(tmp_path):
    columns = table()
    rows = between(3.0, 8.0)  # its step at 5 s included
    columns["pb"][rows] = columns["pb"][rows][0]
    _, faults = read(tmp_path, columns)
    assert faults["pressure"].frozen == (pytest.approx((3.0, 7.95)),)
    # A shorter time may be the delay of the regulator.
    columns = table()
    rows = between(3.0, 5.9)
    columns["pb"][rows] = columns["pb"][rows][0]
    assert read(tmp_path, columns)[1]["pressure"].frozen == ()


def test_a_tracker_that_lost_its_marker_is_frozen(tmp_path):
    """It repeats the last position while the pressures move the arm."""
    columns = table()
    rows = between(4.0, 8.0)
    columns["x"][rows] = columns["x"][rows][0]
    found, faults = read(tmp_path, columns)
    assert faults["tip"].frozen == (pytest.approx((4.0, 7.95)),)
    assert faults["pressure"].left_out == 0
    assert len(found.markers[0].t) == len(T) - faults["tip"].left_out


def test_a_tracker_without_noise_is_frozen_if_the_pressures_move(tmp_path):
    """Positions of coarse steps stand still at each rest; only those that miss a motion are left out."""
    columns = table()
    smooth = np.convolve(columns["pa"], np.ones(20) / 20)[: len(T)]
    columns["x"] = np.round(1e-6 * smooth, 3)
    _, faults = read(tmp_path, columns)
    assert faults["tip"].frozen == ()
    rows = between(4.0, 8.0)
    columns["x"][rows] = columns["x"][rows][0]
    _, faults = read(tmp_path, columns)
    assert len(faults["tip"].frozen) == 1
    start, end = faults["tip"].frozen[0]
    assert start <= 4.0
    assert end == pytest.approx(7.95)


@pytest.mark.parametrize("with_commands", [True, False])
def test_a_sensor_of_coarse_steps_at_rest_is_not_frozen(tmp_path, with_commands):
    """It gives one value for seconds, and all of them count: a line through the first would be a ramp."""
    columns = table(noise_pa=0.0)
    for name in ("pa", "pb"):
        columns[name] = np.round(columns[name], -3)
    found, faults = read(tmp_path, columns, with_commands)
    assert faults["pressure"].frozen == ()
    rest = between(13.0, 15.0)
    assert np.isin(T[rest], found.pressure.t).all()


def test_an_arm_that_a_person_moves_freezes_no_pressure(tmp_path):
    """Pressures at zero to the bit, while the tip is bent and let go."""
    columns = table()
    for name in ("pa", "pb", "ca", "cb"):
        columns[name] = np.zeros(len(T))
    for with_commands in (True, False):
        found, faults = read(tmp_path, columns, with_commands)
        assert faults["pressure"].left_out == 0
        assert len(found.pressure.t) == len(T)


def test_the_times_are_parameters(tmp_path):
    columns = table()
    rows = between(12.0, 14.5)
    for name in ("pa", "pb"):
        columns[name][rows] = columns[name][rows][0]
    _, faults = read(tmp_path, columns, frozen_s=3.0)
    assert (faults["pressure"].frozen, faults["pressure"].repeated >= rows.sum() - 1) == ((), True)
    assert read(tmp_path, columns, flicker=100)[1]["pressure"].frozen == ()
