"""At rest, on every family: whatever a device shows, it gets zeros and is read until it was seen at zero.

A device may have another set point at any time: its power-up set point, a hand at its front panel, another
program. As long as zero is wanted, zeros go out and the pressure is read in turn, neither starves the other
or the other chambers, and `close` calls empty only what was read back empty, within a bounded time.
"""

import contextlib
import os
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rest_bench import FAMILIES, SETTLED_PA

from soro_core.errors import HardwareError
from tests.refused import fails

EXAMPLES = int(os.environ.get("SORO_EXAMPLES", "12"))
LONGEST_CLOSE_S = 4.0  # a ramp down, and the longest wait for empty chambers
Pressure = st.sampled_from([5e3, 30e3, 60e3, 90e3])
Chamber = st.integers(0, 2)

# What happens at rest; every step is followed by its cycles.
Step = st.one_of(
    st.tuples(st.just("given"), Chamber, Pressure),
    st.tuples(st.just("fought for"), Chamber, Pressure),
    st.tuples(st.just("silent"), Chamber, Pressure),
    st.tuples(st.just("restarted"), Chamber, st.just(0.0)),
    st.tuples(st.just("stuck"), Chamber, Pressure),
    st.tuples(st.just("pressed"), Chamber, Pressure),
)
Close = st.sampled_from(["in order", "fought for", "silent", "unplugged"])
Way = st.sampled_from(["exchange", "vent"])
families = pytest.mark.parametrize("family", FAMILIES)
# Where the devices do not vent by themselves, and a second process does.
supervised = pytest.mark.parametrize(
    "family", [name for name, make in FAMILIES.items() if make(0.0).supervise is not None]
)


def cycles(rig, count, way, fight=None):
    """Cycles at zero, by exchanges or vents; demand [Pa] and freshness of every chamber in each."""
    demands, fresh = [], []
    for _ in range(count):
        if fight is not None:
            rig.give(*fight)
        try:
            if way == "vent":
                rig.driver.vent()
            else:
                fresh.append(rig.exchange(0.0).fresh)
        except HardwareError:
            fresh.append(np.zeros(rig.driver.n_chambers, dtype=bool))
        demands.append(rig.demand_pa)
    return np.array(demands), np.array(fresh)


def happen(rig, kind, chamber, pressure_pa, way):
    """One step, and what must hold while it lasts."""
    others = np.arange(rig.driver.n_chambers) != chamber
    if kind == "pressed":
        for _ in range(40):
            with contextlib.suppress(HardwareError):
                rig.exchange(pressure_pa)
    elif kind == "given":
        rig.give(chamber, pressure_pa)
    elif kind == "fought for":
        was_heard = cycles(rig, 2 * rig.patience, "exchange")[1].any(axis=0)
        for _ in range(3):
            demands, fresh = cycles(rig, rig.patience, "exchange", (chamber, pressure_pa))
            assert np.abs(demands[:, chamber]).min() <= SETTLED_PA, "zeros reach it all the time"
            assert np.all(fresh.any(axis=0) == was_heard), "it is read, and so are the others"
        assert np.all(np.abs(demands[:, others]) <= SETTLED_PA)
    elif kind == "silent":
        rig.inject("mute", chamber, duration_s=0.3)
        rig.give(chamber, pressure_pa)
        demands, _ = cycles(rig, max(rig.patience, 60), way)
        assert np.all(np.abs(demands[-1, others]) <= SETTLED_PA)
    elif kind == "stuck":
        rig.inject("stuck_at", chamber, pressure_pa=pressure_pa, duration_s=1.0)
    else:
        rig.restart(chamber)


@pytest.mark.slow
@families
@settings(max_examples=EXAMPLES, deadline=None, derandomize=True)
@given(
    wake_pa=st.sampled_from([0.0, 30e3]),
    steps=st.lists(st.tuples(Step, Way), min_size=1, max_size=4),
    close=Close,
)
def test_zeros_reach_every_device_and_what_is_called_empty_is(family, wake_pa, steps, close):
    rig = FAMILIES[family](wake_pa)
    rig.configure()
    cycles(rig, rig.patience, "exchange")
    assert np.all(np.abs(rig.demand_pa) <= SETTLED_PA)
    has_restarted = False
    for (kind, chamber, pressure_pa), way in steps:
        happen(rig, kind, chamber, pressure_pa, way)
        has_restarted = has_restarted or kind == "restarted"
        if has_restarted and rig.driver.device_watchdog:
            way = "exchange"  # the connection has gone; these vent by themselves, so `vent` leaves it so
        cycles(rig, 60, way)  # silence ends, and devices that boot are up
        demands, _ = cycles(rig, rig.patience, way)
        assert np.all(np.abs(demands[-1]) <= SETTLED_PA), (kind, way)
    if close == "fought for":
        rig.devices.on_tick = lambda *_: rig.give(0, 30e3)
    elif close == "silent":
        rig.inject("mute", 0)
        rig.give(0, 30e3)
    elif close == "unplugged":
        rig.unplug()
    begin_ns = rig.devices.now_ns
    rig.driver.close()
    assert (rig.devices.now_ns - begin_ns) * 1e-9 < LONGEST_CLOSE_S
    if close == "silent" and rig.supervise is not None:
        assert not rig.told.dismissed, "nothing was read back"
    if rig.told.dismissed:
        assert rig.devices.pressure_pa.max() < rig.empty_pa + 500.0


@supervised
def test_an_arm_that_was_empty_and_fills_again_before_the_connection_is_lost_is_not_called_empty(family):
    rig = FAMILIES[family](0.0)
    rig.configure()
    cycles(rig, 40, "exchange")
    rig.inject("stuck_at", 0, pressure_pa=30e3)
    cycles(rig, 100, "exchange")
    assert rig.devices.pressure_pa[0] > 10e3
    rig.unplug()
    rig.driver.close()
    assert rig.told.dismissed is False


@supervised
def test_an_arm_that_was_seen_empty_last_is_called_so_when_the_connection_is_lost(family):
    rig = FAMILIES[family](0.0)
    rig.configure()
    cycles(rig, 40, "exchange")
    rig.unplug()
    rig.driver.close()
    assert rig.told.dismissed is True


@families
def test_no_device_has_its_power_up_set_point_after_the_start_up(family):
    rig = FAMILIES[family](30e3)
    rig.configure()
    if family == "veab_tcp":  # in lockstep its first message is that of the first cycle
        cycles(rig, 1, "exchange")
    assert np.abs(rig.demand_pa).max() <= SETTLED_PA


@supervised
def test_a_device_that_is_silent_at_the_end_is_not_called_empty(family):
    """It may have another set point by now; the end is bounded all the same."""
    rig = FAMILIES[family](0.0)
    rig.configure()
    cycles(rig, 40, "exchange")
    rig.inject("mute", 1)
    begin_ns = rig.devices.now_ns
    rig.driver.close()
    assert rig.told.dismissed is False
    assert (rig.devices.now_ns - begin_ns) * 1e-9 < LONGEST_CLOSE_S


@pytest.mark.parametrize("family", ["itv_rs232", "alicat"])
def test_a_latched_driver_sends_zero_at_the_first_sight_of_another_set_point(family):
    """Nothing is left to be made sure of; SET 0, the reading and the question then take turns."""
    rig = FAMILIES[family](0.0)
    rig.configure()
    rig.give(0, 60e3)
    cycles(rig, rig.patience, "exchange")
    assert {fault.code for fault in rig.driver.latched} == {"rebooted"}
    for port in rig.ports:
        port.take_log()
    rig.give(0, 60e3)
    demands, _ = cycles(rig, rig.patience, "exchange")
    assert np.abs(demands[-1]).max() <= SETTLED_PA
    zeros = {"itv_rs232": "> SET 0", "alicat": "> ALS 0.00"}[family]
    shown = {"itv_rs232": "< 614", "alicat": "+060.00"}[family]
    log = rig.ports[0].take_log()
    (seen,) = [number for number, entry in enumerate(log) if entry.endswith(shown)]
    assert log[seen + 1] == zeros


@pytest.mark.parametrize("family", ["veab_tcp", "itv_rs232", "alicat", "vtem_modbus"])
@pytest.mark.parametrize("how", ["stuck", "unplugged"])
def test_what_was_empty_before_a_start_up_is_not_called_so_after_it(family, how):
    """It fills while the devices start again, or they cannot be reached, and nothing is known any more."""
    rig = FAMILIES[family](0.0)
    rig.configure()
    cycles(rig, 40, "exchange")
    for chamber in range(rig.driver.n_chambers):
        rig.inject("stuck_at", chamber, pressure_pa=30e3)
    if how == "unplugged":
        rig.unplug()
    with contextlib.suppress(HardwareError):
        rig.driver.configure()
    rig.driver.close()
    assert rig.told.dismissed is False


@pytest.mark.parametrize("firmware", ["5v12.0-R22", "10v20.0-R24"])
def test_a_unit_that_does_not_tell_what_it_is_gets_zero_and_is_not_called_empty(firmware):
    """At its power-up set point, from a start-up that has failed on."""
    rig = FAMILIES["alicat"](30e3)
    strange = rig.devices.valves[1]
    strange.version = tuple(map(int, firmware.split(".")[0].split("v")))
    answer = strange.command
    strange.command = lambda text: [b"B what?"] if text.startswith(("VE", "??")) else answer(text)
    with fails(HardwareError, step="firmware", code="refused"):
        rig.configure()
    rig.supervise(rig.told)
    cycles(rig, rig.patience, "vent")
    assert np.abs(rig.demand_pa).max() <= SETTLED_PA
    steps = [step for step in rig.driver.vent_plans[0].steps if step["of"] == "link0/chamber1"]
    assert [step["send"] for step in steps] == ["BS0\r"]
    assert not any(re.fullmatch(step["line"], "B +000.00 +000.00") for step in steps), "nothing confirms it"
    rig.driver.close()
    assert rig.told.dismissed is False


@pytest.mark.parametrize("is_stuck", [False, True])
@pytest.mark.parametrize("second", ["none", "ended"])
@supervised
def test_without_a_second_process_an_arm_that_was_not_seen_empty_is_told(family, second, is_stuck, caplog):
    """It is switched off in the platform, or has ended before the driver."""
    rig = FAMILIES[family](0.0)
    rig.told.is_alive = False
    if second == "none":
        rig.supervise = None
    rig.configure()
    cycles(rig, 40, "exchange")
    if is_stuck:
        rig.inject("stuck_at", 0, pressure_pa=30e3)
        cycles(rig, 100, "exchange")
    rig.driver.close()
    assert ("has not seen the arm empty: open the dump valve" in caplog.text) is is_stuck
