"""A scene in lockstep whose chambers hold air behind valves, in place of a lag of first order."""

import numpy as np
import pytest

from soro_core.robot import Discretisation
from soro_lab.scene import Scene
from soro_lab.trade.closed_loop import drive

# Chambers of 1.5 ml that fill about as fast as the lag that the controller knows of.
VALVE = {"fill_m3_s_pa": 1e-11, "vent_m3_s_pa": 1e-11}


def run(seconds, **twin):
    scene = Scene(mode="lockstep", twin={"payload_kg": 0.02, **twin})
    return drive(scene, Discretisation(), seconds)


@pytest.mark.slow
def test_the_circle_on_air_behind_valves():
    record = run(8.0, air="states", valve=VALVE)
    error = 1e3 * record.tracking_error_m(2.0)
    print(f"tip RMS {error:.2f} mm, pressures to {1e-3 * record.pressure_pa.max():.0f} kPa")
    assert error < 1.2
    assert -1.0 < record.pressure_pa.min() < record.pressure_pa.max() < 90e3


def test_one_second_is_the_same_to_the_bit_and_not_that_of_a_lag():
    one, two, lag = (run(1.0, **keys) for keys in ({"air": "states", "valve": VALVE},) * 2 + ({},))
    assert one.pressure_pa.tobytes() == two.pressure_pa.tobytes()
    assert one.distance_m.tobytes() == two.distance_m.tobytes()
    apart = np.abs(one.pressure_pa - lag.pressure_pa).max()
    assert apart > 500.0
    assert one.tracking_error_m(0.2) == pytest.approx(lag.tracking_error_m(0.2), rel=0.5)
