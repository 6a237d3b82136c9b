"""The CANopen driver in lockstep: healthy cycles, units, refused set points, vent, close."""

import can
import numpy as np
import pytest
from hardware_bench import Bench, codes, platform, set_points, single
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.errors import HardwareError
from soro_hardware.canopen import frames
from soro_hardware.canopen.cia408 import ValveState
from soro_hardware.canopen.frames import NmtCommand, NmtState
from tests.refused import fails


def test_pressures_follow(arm):
    result = arm.exchange(20e3, 40e3, 60e3)
    np.testing.assert_allclose(result.sent_pa, [20e3, 40e3, 60e3])
    np.testing.assert_allclose(result.pressure_pa, [19.5e3, 39.5e3, 59.5e3], atol=600.0)
    assert result.fresh.all()
    counts = arm.driver.statistics
    assert (counts.cycles, counts.frames_lost, counts.frames_garbled) == (101, 0, 0)


def test_host_sends_its_heartbeat_every_25_ms(arm):
    arm.run(100, 20e3)
    assert arm.bus.take_log().count("> 77F [1] 05") == 20


def test_repeated_run_is_bit_identical():
    def run(seed):
        bench = Bench(platform(), seed)
        bench.driver.configure()
        inputs = np.random.default_rng(1).uniform(0, 90e3, (300, 3))
        results = [bench.exchange(*row) for row in inputs]
        bench.driver.close()
        readings = np.array([r.pressure_pa for r in results])
        return readings.tobytes(), bench.bus.take_log(), bench.driver.statistics

    assert run(5) == run(5)
    assert run(5)[0] != run(6)[0]


def test_readings_have_a_sign():
    """Noise around 0 Pa goes below it."""
    bench = Bench(single())
    bench.driver.configure()
    readings = [bench.exchange(0.0).pressure_pa[0] for _ in range(100)]
    assert min(readings) < 0.0
    assert max(np.abs(readings)) < 1e3


def test_configured_arm_waits_any_time_for_its_first_exchange():
    """The watchdogs begin with the first frame that they watch; until then the valves hold 0 Pa."""
    bench = Bench(platform())
    bench.driver.configure()
    for _ in range(1000):
        bench.send(frames.SYNC)
    assert bench.world.pressure_pa.max() < 500.0
    assert {node.valve.state for node in bench.world.nodes} == {ValveState.HOLD}
    bench.cycle = 10_000
    assert bench.run(3, 20e3).faults == ()


UNITS = {
    "Pa x 10": ({"pressure_unit": "pa", "pressure_prefix": 1}, {}, 10.0),
    "kPa": ({"pressure_unit": "pa", "pressure_prefix": 3}, {}, 1000.0),
    "mbar": ({"pressure_unit": "bar", "pressure_prefix": -3}, {}, 100.0),
    "0.1 mbar": ({"pressure_unit": "bar", "pressure_prefix": -4}, {}, 10.0),
    "normalised": (
        {"pressure_unit": "normalised", "full_scale_pa": 100e3},
        {"full_scale_pa": 100e3},
        100e3 / 16384,
    ),
}


@pytest.mark.parametrize(("emulation", "canopen", "count"), UNITS.values(), ids=UNITS.keys())
def test_units_are_read_from_the_device(emulation, canopen, count):
    bench = Bench(single(emulation=emulation, canopen=canopen))
    bench.driver.configure()
    result = bench.run(150, 51_234.0)
    assert result.sent_pa[0] == pytest.approx(round(51_234 / count) * count)
    assert abs(result.sent_pa[0] - 51_234.0) <= count / 2 + 1e-6
    true = bench.world.pressure_pa[0]
    assert true == pytest.approx(51_234.0, abs=500.0 + count)
    assert result.pressure_pa[0] == pytest.approx(true, abs=600.0 + count)
    valve = bench.world.nodes[0].valve
    valve.give(32767 * count, "setpoint")
    assert 0.0 < valve.demand_pa() <= 90e3 + 1e-6


BAD = {"NaN": np.nan, "inf": np.inf, "-inf": -np.inf, "too high": 90_001.0, "below": -1.0, "huge": 1e300}


@pytest.mark.parametrize("value", BAD.values(), ids=BAD.keys())
def test_bad_set_point_is_refused_whole(arm, value):
    """One bad value, and zeros are sent for every chamber; a good command later is taken again."""
    result = arm.exchange(20e3, value, 60e3)
    assert codes(result) == {("refused_setpoint", "link0/chamber1")}
    assert not result.sent_pa.any()
    assert [pa for _, _, pa in set_points(arm.bus.take_log())] == [0, 0, 0]
    assert arm.run(3, 20e3, 40e3, 60e3).faults == ()


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.lists(
            st.floats(allow_nan=True, allow_infinity=True) | st.floats(-1e3, 92e3) | st.floats(0, 90e3),
            min_size=3,
            max_size=3,
        ),
        min_size=1,
        max_size=8,
    )
)
def test_nothing_out_of_range_ever_reaches_the_wire(commands):
    bench = Bench(platform())
    bench.driver.configure()
    bench.bus.take_log()
    for row in commands:
        bench.exchange(*row)
    sent = set_points(bench.bus.take_log())
    assert len(sent) == 3 * len(commands)
    assert all(0 <= counts <= 9000 for _, _, counts in sent)


def test_wrong_shape(arm):
    with fails(HardwareError, "(2,)", "3", code="setting"):
        arm.driver.exchange(np.zeros(2), 0)


def test_vent_has_no_slew(arm):
    arm.driver.vent()
    assert {counts for _, _, counts in set_points(arm.bus.take_log())} == {0}
    for _ in range(100):
        arm.driver.vent()
    assert arm.world.pressure_pa.max() < 500.0
    assert {node.valve.state for node in arm.world.nodes} == {ValveState.HOLD}
    assert arm.exchange(20e3).faults == (), "a vent alone does not latch: that is the safety's task"


def test_device_may_take_its_time_from_hold_to_active_again(arm):
    arm.driver.vent()
    arm.driver.vent()
    valve, on_write = arm.world.nodes[0].valve, arm.world.nodes[0].dictionary.on_write
    slow, take_control = iter([False] * 5), on_write[0x6040, 0]
    on_write[0x6040, 0] = lambda word: next(slow, True) and take_control(word)
    for _ in range(10):
        assert arm.exchange(20e3).faults == ()
    assert valve.state is ValveState.ACTIVE


@pytest.mark.parametrize("state", list(ValveState))
@pytest.mark.parametrize(
    "command", [None, NmtCommand.PRE_OPERATIONAL, NmtCommand.STOP, NmtCommand.RESET_NODE]
)
def test_vent_from_every_state(arm, state, command):
    arm.world.nodes[0].valve.state = state
    if command is not None:
        arm.send(frames.nmt(command, 1))
    for _ in range(100):
        arm.driver.vent()
    assert arm.world.pressure_pa.max() < 500.0


def test_vent_before_and_after():
    bench = Bench(single())
    bench.driver.vent()
    bench.driver.configure()
    bench.driver.vent()
    bench.driver.close()
    bench.bus.take_log()
    bench.driver.vent()
    assert bench.bus.take_log() == []


def test_close_is_idempotent_and_orderly(arm):
    arm.driver.close()
    log = arm.bus.take_log()
    sent = [counts for node, _, counts in set_points(log) if node == 3]
    assert sent[:4] == [5800, 5600, 5400, 5200], "400 kPa/s at 200 Hz"
    controls = [control for node, control, _ in set_points(log) if node == 3]
    assert controls[-4:] == [7, 3, 1, 0]
    assert log[-2:] == ["> 000 [2] 02 03", "< 703 [1] 04"]
    assert arm.world.pressure_pa.max() < 2.5e3
    assert {node.state for node in arm.world.nodes} == {NmtState.STOPPED}
    arm.driver.close()
    assert arm.bus.take_log() == []
    for _ in range(100):
        arm.send(frames.SYNC)
    assert {node.valve.state for node in arm.world.nodes} == {ValveState.INIT}, "no valve reports a lost host"
    with fails(HardwareError, code="order"):
        arm.driver.configure()
    with fails(HardwareError, code="order"):
        arm.exchange(20e3)


def test_close_may_take_its_time(arm):
    """From the last set point to NMT stop no watchdog of a device runs out, though the host is slow."""
    send = arm.bus.send

    def slow(message, timeout=None):
        if bytes(message.data[:3]) == bytes.fromhex("23 16 10"):
            for _ in range(18):  # 90 ms pass for the devices
                arm.send(frames.SYNC)
        send(message)

    arm.bus.send = slow
    arm.driver.close()
    assert arm.driver.statistics.emergencies == 0
    assert {node.valve.state for node in arm.world.nodes} == {ValveState.INIT}


def test_close_with_a_silent_node():
    bench = Bench(platform(lockstep_timeout_s=0.1, canopen={"sdo_timeout_s": 0.01, "sdo_retries": 0}))
    bench.driver.configure()
    bench.run(100, 20e3)
    bench.bus.swallow = {0x182, 0x582, 0x702}
    bench.driver.close()
    assert bench.world.pressure_pa.max() < 2.5e3
    assert {node.state for node in bench.world.nodes} == {NmtState.STOPPED}


def test_close_without_configure():
    Bench(single()).driver.close()


def test_close_when_the_bus_is_gone(arm, monkeypatch):
    def gone(*_):
        raise can.CanOperationError("gone")

    monkeypatch.setattr(arm.bus, "send", gone)
    with fails(HardwareError, code="gone"):
        arm.exchange(20e3)
    arm.driver.vent()
    arm.driver.close()
