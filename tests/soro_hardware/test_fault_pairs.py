"""Two faults at once, or one in the vent or reset of another: the latch holds, the arm vents and recovers."""

import numpy as np
import pytest

from soro_hardware.emulation.faults.fault_types import Injection
from tests.apparatus.faults.matrix import FOUR, MATRIX
from tests.apparatus.faults.pairs import HEALTHY, Watched, drawn, run
from tests.apparatus.faults.rigs import rig_of

TRIPS = 1  # seed of a pair that does
SEEDS = [(family, seed) for family in MATRIX for seed in range(1 if family == FOUR else 2)]


@pytest.mark.parametrize(("family", "seed"), SEEDS)
def test_pair(family, seed):
    pair = drawn(family, seed)
    assert run(pair) == (), str(pair)


def test_a_pair_can_fail(monkeypatch):
    monkeypatch.setattr(Watched, "reset", lambda loop: "no")
    assert "reset refused: ['no', 'no', 'no']" in run(drawn("veab_tcp", TRIPS))[-1]


@pytest.fixture
def arm(family):
    """An arm whose line went under pressure, and whose reset was refused while it was gone."""
    loop = Watched(rig_of(family, HEALTHY))
    loop.rig.regulator.configure()
    loop.spin(0.6)
    loop.inject((Injection(fault="adapter_unplug"),))
    loop.spin(0.1)
    loop.spin(0.1, pressed=False)
    assert loop.reset() is not None
    assert loop.rig.devices.pressure_pa.max() > 50e3
    yield loop
    loop.rig.close()


@pytest.mark.parametrize("family", ["veab_tcp", "vtem_modbus"])
def test_a_refused_reset_does_not_end_the_vent(arm):
    """Nobody but the driver vents these devices: when they are reached again they get their zeros."""
    arm.rig.devices.faults.clear()
    arm.rig.mend()
    arm.spin(1.0, pressed=False)
    assert arm.vented
    assert np.abs(arm.rig.devices.pressure_pa).max() < 1e3


@pytest.mark.parametrize("family", ["itv_rs232", "alicat"])
def test_a_device_that_does_not_start_leaves_no_pressure(arm):
    """Not in the others, nor in itself: it is not heard, but it may hear."""
    arm.rig.devices.faults.clear()
    arm.inject((Injection(fault="mute", chamber="link0/chamber0"),))
    assert "link0/chamber0" in arm.reset()
    arm.spin(1.0, pressed=False)
    assert np.abs(arm.rig.devices.pressure_pa).max() < 1e3
