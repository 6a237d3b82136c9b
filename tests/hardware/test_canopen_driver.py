"""The CANopen driver on emulated nodes in lockstep: faults, latches, vents, scaling, start-up errors."""

import can
import numpy as np
import pytest
from hardware_bench import PERIOD_NS, Bench, platform, single
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.errors import HardwareError
from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.cia408 import State
from soro_core.hardware.canopen.driver import CanopenRegulator
from soro_core.hardware.canopen.frames import NmtCommand, NmtState
from soro_core.hardware.transport.frame import Frame

RANGE = {"minimum_pa": 0.0, "maximum_pa": 90e3}


@pytest.fixture
def bench():
    """Three valves at 20, 40 and 60 kPa."""
    bench = Bench(platform())
    bench.driver.configure()
    result = bench.run(100, 20e3, 40e3, 60e3)
    assert result.faults == ()
    bench.bus.take_log()
    return bench


def codes(result):
    return {(fault.code, fault.source) for fault in result.faults}


def set_points(log):
    """Control word and set point of every RPDO that was sent, by node."""
    rpdos = [line.split() for line in log if line.startswith("> 20")]
    return [
        (int(r[1], 16) - 0x200, int(r[3], 16), int.from_bytes(bytes.fromhex(r[5] + r[6]), "little"))
        for r in rpdos
    ]


# -- a healthy cycle ------------------------------------------------------------------------------


def test_pressures_follow(bench):
    result = bench.exchange(20e3, 40e3, 60e3)
    np.testing.assert_allclose(result.sent_pa, [20e3, 40e3, 60e3])
    np.testing.assert_allclose(result.pressure_pa, [19.5e3, 39.5e3, 59.5e3], atol=600.0)
    assert result.fresh.all()
    counts = bench.driver.statistics
    assert (counts.cycles, counts.frames_lost, counts.frames_garbled) == (101, 0, 0)


def test_host_sends_its_heartbeat_every_25_ms(bench):
    bench.run(100, 20e3)
    assert bench.bus.take_log().count("> 77F [1] 05") == 20


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


def test_configured_arm_waits_any_time_for_its_first_exchange(bench):
    """The watchdogs begin with the first frame that they watch; until then the valves hold 0 Pa."""
    fresh = Bench(platform())
    fresh.driver.configure()
    for _ in range(1000):
        fresh.send(frames.SYNC)
    assert fresh.world.pressure_pa.max() < 500.0
    assert {node.valve.state for node in fresh.world.nodes} == {State.HOLD}
    fresh.cycle = 10_000
    assert fresh.run(3, 20e3).faults == ()


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
    assert bench.world.nodes[0].valve._limited(32767) * count <= 90e3 + 1e-6


# -- refused set points ---------------------------------------------------------------------------

BAD = {"NaN": np.nan, "inf": np.inf, "-inf": -np.inf, "too high": 90_001.0, "below": -1.0, "huge": 1e300}


@pytest.mark.parametrize("value", BAD.values(), ids=BAD.keys())
def test_bad_set_point_is_refused_whole(bench, value):
    """One bad value, and zeros are sent for every chamber; a good command later is taken again."""
    result = bench.exchange(20e3, value, 60e3)
    assert codes(result) == {("refused_setpoint", "link0/chamber1")}
    assert not result.sent_pa.any()
    assert [pa for _, _, pa in set_points(bench.bus.take_log())] == [0, 0, 0]
    assert bench.run(3, 20e3, 40e3, 60e3).faults == ()


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


def test_wrong_shape(bench):
    with pytest.raises(HardwareError, match=r"\(2,\) set points for 3 chambers"):
        bench.driver.exchange(np.zeros(2), 0)


# -- faults ---------------------------------------------------------------------------------------


def vents_and_latches(bench, code, source, cycles=3):
    """The fault is named, zeros go out from the next cycle on, and stay until the start-up has run again."""
    for _ in range(cycles):
        result = bench.exchange(20e3, 40e3, 60e3)
        if (code, source) in codes(result):
            break
    assert (code, source) in codes(result)
    assert all(fault.latched for fault in result.faults if fault.code == code)
    for _ in range(200):
        result = bench.exchange(20e3, 40e3, 60e3)
        assert not result.sent_pa.any()
        assert (code, source) in codes(result)
    assert bench.world.pressure_pa.max() < 500.0
    bench.driver.configure()
    assert bench.run(100, 20e3, 40e3, 60e3).faults == ()
    np.testing.assert_allclose(bench.world.pressure_pa, [20e3, 40e3, 60e3], atol=600.0)


NODE_2 = "link0/chamber1 (node 2)"


@pytest.mark.parametrize("end", [State.FAULT_HOLD, State.FAULT_DISABLED, State.FAULT_INIT])
def test_emergency(bench, end):
    bench.world.nodes[1].fault(0x2320, 1, end)
    vents_and_latches(bench, "emergency", NODE_2)
    assert bench.driver.statistics.emergencies == 1


def test_rebooted_node(bench):
    bench.world.nodes[1].reset(bench.world.now_ns)
    vents_and_latches(bench, "rebooted", NODE_2)


def test_node_that_falls_out_of_active_without_a_word(bench):
    bench.world.nodes[1].valve.state = State.FAULT_DISABLED
    vents_and_latches(bench, "not_active", NODE_2)


def test_fault_reaction_is_not_active(bench):
    """0111 has all bits of ACTIVE but R."""
    bench.world.nodes[1].valve.state = State.FAULT_REACTION
    bench.world.nodes[1].valve._after_reaction = (10**18, State.FAULT_HOLD)
    assert ("not_active", NODE_2) in codes(bench.exchange(20e3))


def test_node_that_never_becomes_active():
    bench = Bench(platform(canopen={"activation_timeout_s": 0.1}))
    bench.driver.configure()
    bench.world.nodes[1].dictionary.on_write[0x6040, 0] = lambda _: None
    assert bench.run(20, 20e3).faults == ()
    result = bench.run(3, 20e3)
    assert codes(result) == {("not_active", NODE_2)}
    assert "stays in hold" in result.faults[0].message


def test_node_that_leaves_operational(bench):
    bench.send(frames.nmt(NmtCommand.PRE_OPERATIONAL, 2))
    vents_and_latches(bench, "left_operational", NODE_2, cycles=8)


def test_silent_node(bench):
    """A node whose frames no longer come: stale after 3 cycles, lost after 100 ms."""
    bench.bus.swallow = {0x182, 0x702}
    found = {}
    for cycle in range(40):
        for fault in bench.exchange(20e3, 40e3, 60e3).faults:
            found.setdefault(fault.code, cycle)
            assert fault.source == NODE_2
    assert found["stale_reading"] == 2
    assert 19 <= found["heartbeat_lost"] <= 25
    assert bench.driver.statistics.frames_lost == 40


def test_one_lost_reading_is_tolerated(bench):
    bench.bus.swallow = {0x182}
    result = bench.exchange(20e3, 40e3, 60e3)
    assert result.faults == ()
    assert result.fresh.tolist() == [True, False, True]
    assert result.pressure_pa[1] == pytest.approx(39.5e3, abs=600.0), "the last one stays"
    bench.bus.swallow = set()
    assert bench.exchange(20e3, 40e3, 60e3).fresh.all()
    assert bench.driver.statistics.frames_lost == 1


def test_late_reading_is_no_fresh_one(bench):
    bench.bus.swallow = {0x182}
    bench.exchange(20e3, 40e3, 60e3)
    bench.bus.inject(Frame(0x182, b"\x0f\x01\x10\x27"))
    result = bench.exchange(20e3, 40e3, 60e3)
    assert not result.fresh[1]
    assert result.pressure_pa[1] == 100e3
    assert bench.driver.statistics.frames_late == 1


def test_all_clear_of_an_emergency_is_no_fault(bench):
    bench.bus.inject(frames.emergency(2, 0, 0))
    assert bench.exchange(20e3).faults == ()


GARBAGE = [
    Frame(0x182, b"\x0f"),
    Frame(0x182, b""),
    Frame(0x702, b""),
    Frame(0x702, b"\x05\x05"),
    Frame(0x082, b"\x30\x81"),
    Frame(0x182, bytes(4), extended=True),
    Frame(0x182, b"", remote=True, length=4),
    Frame(0x7E5, bytes(8)),
    Frame(0x185, bytes(4)),
    Frame(0x705, b"\x00"),
    Frame(0x582, bytes(8)),
]


@pytest.mark.parametrize("frame", GARBAGE, ids=str)
def test_malformed_and_foreign_frames_change_nothing(bench, frame):
    bench.bus.inject(frame)
    result = bench.exchange(20e3, 40e3, 60e3)
    assert result.faults == ()
    assert result.fresh.all()


def test_random_frames(bench):
    """Any frames from the bus: nothing raises, and what is sent stays in range."""
    noise = np.random.default_rng(9)
    for _ in range(2000):
        for _ in range(noise.integers(4)):
            data = noise.bytes(int(noise.integers(9)))
            bench.bus.inject(Frame(int(noise.integers(0x800)), data))
        bench.exchange(20e3, 40e3, 60e3)
    assert all(0 <= counts <= 9000 for _, _, counts in set_points(bench.bus.take_log()))


def test_bus_off_stops_everything_until_reset(bench, monkeypatch):
    monkeypatch.setattr(type(bench.bus), "state", property(lambda self: can.BusState.ERROR))
    result = bench.exchange(20e3, 40e3, 60e3)
    assert codes(result) == {("bus_off", "bus")}
    bench.driver.vent()
    assert not result.fresh.any()
    assert bench.bus.take_log() == [], "nothing is sent to a bus that is off"
    monkeypatch.undo()
    assert codes(bench.exchange(20e3)) == {("bus_off", "bus")}
    bench.driver.configure()
    assert bench.run(5, 20e3).faults == ()


# -- venting and closing --------------------------------------------------------------------------


def test_vent_has_no_slew(bench):
    bench.driver.vent()
    assert {counts for _, _, counts in set_points(bench.bus.take_log())} == {0}
    for _ in range(100):
        bench.driver.vent()
    assert bench.world.pressure_pa.max() < 500.0
    assert {node.valve.state for node in bench.world.nodes} == {State.HOLD}
    assert bench.exchange(20e3).faults == (), "a vent alone does not latch: that is the safety's task"


@pytest.mark.parametrize("state", list(State))
@pytest.mark.parametrize(
    "command", [None, NmtCommand.PRE_OPERATIONAL, NmtCommand.STOP, NmtCommand.RESET_NODE]
)
def test_vent_from_every_state(bench, state, command):
    bench.world.nodes[0].valve.state = state
    if command is not None:
        bench.send(frames.nmt(command, 1))
    for _ in range(100):
        bench.driver.vent()
    assert bench.world.pressure_pa.max() < 500.0


def test_vent_before_and_after():
    bench = Bench(single())
    bench.driver.vent()
    bench.driver.configure()
    bench.driver.vent()
    bench.driver.close()
    bench.bus.take_log()
    bench.driver.vent()
    assert bench.bus.take_log() == []


def test_close_is_idempotent_and_orderly(bench):
    bench.driver.close()
    log = bench.bus.take_log()
    sent = [counts for node, _, counts in set_points(log) if node == 3]
    assert sent[:4] == [5800, 5600, 5400, 5200], "400 kPa/s at 200 Hz"
    controls = [control for node, control, _ in set_points(log) if node == 3]
    assert controls[-4:] == [7, 3, 1, 0]
    assert log[-1] == "> 000 [2] 02 03"
    assert bench.world.pressure_pa.max() < 2.5e3
    assert {node.state for node in bench.world.nodes} == {NmtState.STOPPED}
    bench.driver.close()
    assert bench.bus.take_log() == []
    for _ in range(100):
        bench.send(frames.SYNC)
    assert {node.valve.state for node in bench.world.nodes} == {State.INIT}, "no valve reports a lost host"
    with pytest.raises(HardwareError, match="closed"):
        bench.driver.configure()
    with pytest.raises(HardwareError, match="before configure"):
        bench.exchange(20e3)


def test_close_with_a_silent_node(bench):
    bench = Bench(platform(lockstep_timeout_s=0.1, canopen={"sdo_timeout_s": 0.01, "sdo_retries": 0}))
    bench.driver.configure()
    bench.run(100, 20e3)
    bench.bus.swallow = {0x182, 0x582, 0x702}
    bench.driver.close()
    assert bench.world.pressure_pa.max() < 2.5e3
    assert {node.state for node in bench.world.nodes} == {NmtState.STOPPED}


def test_close_without_configure():
    Bench(single()).driver.close()


def test_close_when_the_bus_is_gone(bench, monkeypatch):
    def gone(*_):
        raise can.CanOperationError("gone")

    monkeypatch.setattr(bench.bus, "send", gone)
    with pytest.raises(HardwareError, match="sending failed"):
        bench.exchange(20e3)
    bench.driver.vent()
    bench.driver.close()


# -- start-up errors ------------------------------------------------------------------------------

QUICK = {"boot_timeout_s": 0.01, "sdo_timeout_s": 0.01, "sdo_retries": 1, "activation_timeout_s": 0.05}


def sabotage(node, what):
    """Make one device wrong."""
    dictionary = node.dictionary
    if what == "profile":
        dictionary.values[0x1000, 0] = 401
    elif what == "unit":
        dictionary.values[0x6380, 2] = 0x33
    elif what == "coarse":
        dictionary.values[0x6380, 3] = 5
    elif what == "no limit":
        for key in [key for key in dictionary.entries if key[0] == 0x63A0]:
            del dictionary.entries[key]
        dictionary._indices.discard(0x63A0)
    elif what == "forgets":
        dictionary.on_read[0x6394, 1] = lambda: 7
    elif what == "map":
        dictionary.on_read[0x1600, 2] = lambda: 0x63000110
    elif what == "stuck":
        dictionary.on_write[0x6040, 0] = lambda _: None


STARTUP = {
    "profile": r"device type: the device has profile 401, not 408",
    "unit": r"units: unit 0x33",
    "coarse": r"units: one count is 100000 Pa",
    "no limit": r"limits: SDO write 63A0:1 = 9000 refused: 0x06020000 no object",
    "forgets": r"hold set point: wrote 6394:1 = 0, the device has 7",
    "map": r"mapping 1600: wrote 1600:2 = 1669333264, the device has 1660944656",
    "stuck": r"state machine to hold: control word 1 does not lead to disabled, found init",
}


@pytest.mark.parametrize(("what", "text"), STARTUP.items(), ids=STARTUP.keys())
def test_start_up_error_names_device_and_step(what, text):
    bench = Bench(platform(canopen=QUICK))
    sabotage(bench.world.nodes[1], what)
    with pytest.raises(HardwareError, match=rf"^link0/chamber1 \(node 2\): {text}"):
        bench.driver.configure()
    with pytest.raises(HardwareError, match="before configure"):
        bench.exchange(0.0)
    bench.driver.vent()
    bench.driver.close()
    assert bench.world.pressure_pa.max() == 0.0


def test_absent_node():
    bench = Bench(platform(canopen=QUICK))
    bench.bus.swallow = {0x582}
    with pytest.raises(HardwareError, match=r"^link0/chamber1 \(node 2\): boot: no answer for 0.01 s"):
        bench.driver.configure()


def test_wrong_identity():
    bench = Bench(single(canopen={"product_code": 0x1234}))
    with pytest.raises(HardwareError, match="identity: product 0x408, the platform asks for 0x1234"):
        bench.driver.configure()


def test_lost_sdo_answer_is_retried(bench):
    bench = Bench(single(canopen={"sdo_timeout_s": 0.01}))
    lost = []

    def recv(timeout=None):
        message = type(bench.bus).recv(bench.bus, timeout)
        if message is not None and message.arbitration_id == 0x581 and len(lost) < 2:
            lost.append(message)
            return None
        return message

    bench.bus.recv = recv
    bench.driver.configure()
    assert len(lost) == 2
    assert bench.exchange(20e3).faults == ()


def test_reboot_during_start_up():
    bench = Bench(single())
    node = bench.world.nodes[0]
    send = bench.bus.send

    def reboot_after_limits(message, timeout=None):
        send(message)
        if bytes(message.data[:4]) == bytes.fromhex("2B A0 63 01"):
            node.reset(bench.world.now_ns)

    bench.bus.send = reboot_after_limits
    with pytest.raises(HardwareError, match=r"link0/chamber0 \(node 1\): .*(booted again|the device has)"):
        bench.driver.configure()


def test_start_up_over_a_running_session(bench):
    """A second driver takes over valves that a killed one has left ACTIVE."""
    driver = CanopenRegulator(bench.platform, lambda: bench.bus, clock=lambda: 0.0, lockstep=True)
    driver.configure()
    assert {node.valve.state for node in bench.world.nodes} == {State.HOLD}
    result = driver.exchange(np.full(3, 10e3), 50 * PERIOD_NS)
    assert result.faults == ()
    assert result.fresh.all()
