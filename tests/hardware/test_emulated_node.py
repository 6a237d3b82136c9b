"""Emulated nodes by themselves: SDO answers, mapping rules, PDOs, heartbeats, deadlines, faults, boot."""

import numpy as np
import pytest
from hardware_bench import Bench, platform, single

from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.cia408 import State
from soro_core.hardware.canopen.frames import NmtCommand, NmtState, SdoAbort
from soro_core.hardware.emulation.dictionary import VALVE_EDS, load_dictionary
from soro_core.hardware.emulation.hub import Hub
from soro_core.hardware.emulation.world import World
from soro_core.hardware.transport.frame import Frame

HEARTBEAT = frames.heartbeat(127, NmtState.OPERATIONAL)
S = State


@pytest.fixture
def bench():
    """One node as it comes from power-on: pre-operational, nothing configured."""
    return Bench(single())


@pytest.fixture
def running():
    """One node in ACTIVE at 50 kPa."""
    bench = Bench(single())
    bench.driver.configure()
    bench.run(100, 50e3)
    bench.bus.take_log()
    return bench


def ticks(bench, count, *also):
    """SYNCs, each with some frames before it; everything that the node sent."""
    bench.bus._frames.clear()
    for _ in range(count):
        for frame in (*also, frames.SYNC):
            bench.send(frame)
    sent = list(bench.bus._frames)
    bench.bus._frames.clear()
    return sent


def emergencies(sent):
    return [f"{int.from_bytes(f.data[:2], 'little'):04X}" for f in sent if f.can_id == 0x081]


# -- SDO ------------------------------------------------------------------------------------------

SDO = {
    "read four bytes": ("40 00 10 00 00 00 00 00", "43 00 10 00 98 01 00 00"),
    "read two bytes": ("40 17 10 00 00 00 00 00", "4B 17 10 00 00 00 00 00"),
    "read one byte": ("40 80 63 02 00 00 00 00", "4F 80 63 02 22 00 00 00"),
    "read its serial number": ("40 18 10 04 00 00 00 00", "43 18 10 04 01 00 00 00"),
    "write": ("2B 17 10 00 64 00 00 00", "60 17 10 00 00 00 00 00"),
    "segmented download": ("21 17 10 00 08 00 00 00", "80 17 10 00 01 00 04 05"),
    "upload segment": ("60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"),
    "write to read-only": ("2B 41 60 00 00 00 00 00", "80 41 60 00 02 00 01 06"),
    "no object": ("40 00 20 00 00 00 00 00", "80 00 20 00 00 00 02 06"),
    "no sub-index": ("40 80 63 07 00 00 00 00", "80 80 63 07 11 00 09 06"),
    "length": ("2F 17 10 00 64 00 00 00", "80 17 10 00 10 00 07 06"),
    "too high": ("2F 43 60 00 05 00 00 00", "80 43 60 00 31 00 09 06"),
    "too low": ("2F 43 60 00 03 00 00 00", "80 43 60 00 32 00 09 06"),
    "reserved transmission type": ("2F 00 14 02 F5 00 00 00", "80 00 14 02 31 00 09 06"),
    "entry of a map in use": ("23 00 16 01 10 00 40 60", "80 00 16 01 22 00 00 08"),
    "count of a map in use": ("2F 00 16 00 00 00 00 00", "80 00 16 00 22 00 00 08"),
    "other identifier in use": ("23 00 14 01 05 02 00 00", "80 00 14 01 22 00 00 08"),
    "client's abort": ("80 00 10 00 00 00 04 05", ""),
}


@pytest.mark.parametrize(("request_", "answer"), SDO.values(), ids=SDO.keys())
def test_sdo(bench, request_, answer):
    assert bench.sdo(request_) == answer


def test_write_only_object_cannot_be_read(bench):
    dictionary = bench.world.nodes[0].dictionary
    entry = dictionary.entries[0x6040, 0]
    dictionary.entries = {
        **dictionary.entries,
        (0x6040, 0): type(entry)(**{**vars(entry), "readable": False}),
    }
    assert bench.sdo("40 40 60 00 00 00 00 00") == "80 40 60 00 01 00 01 06"


@pytest.mark.parametrize("index", ["94", "A0", "A1"])
def test_parameters_are_settable_in_init_only(running, index):
    assert running.sdo(f"2B {index} 63 01 00 00 00 00") == f"80 {index} 63 01 22 00 00 08"


def test_every_abort_code_has_a_name():
    assert frames.abort_text(SdoAbort.NO_OBJECT) == "0x06020000 no object"
    assert frames.abort_text(0x08000020) == "0x08000020"


def test_dictionary_is_that_of_the_eds():
    text = VALVE_EDS.read_text()
    listed = {int(line[1:5], 16) for line in text.splitlines() if line.startswith("[") and line[5:6] in "]s"}
    assert {index for index, _ in load_dictionary(5).entries} == listed
    assert load_dictionary(5).values[0x1800, 1] == 0x185


# -- mapping --------------------------------------------------------------------------------------

OFF, CLEAR = "23 00 18 01 81 01 00 80", "2F 00 1A 00 00 00 00 00"
REMAP = {
    "entry before the count is 0": ([OFF, "23 00 1A 01 10 01 81 63"], "22 00 00 08"),
    "object that does not exist": ([OFF, CLEAR, "23 00 1A 01 10 00 99 63"], "00 00 02 06"),
    "object that is not mappable": ([OFF, CLEAR, "23 00 1A 01 10 01 94 63"], "41 00 04 06"),
    "wrong number of bits": ([OFF, CLEAR, "23 00 1A 01 08 01 81 63"], "41 00 04 06"),
    "count beyond the entries": ([OFF, CLEAR, "2F 00 1A 00 03 00 00 00"], "00 00 02 06"),
    "more than 64 bits": (
        [OFF, CLEAR, *(f"23 00 1A 0{n} 10 01 81 63" for n in range(1, 6)), "2F 00 1A 00 05 00 00 00"],
        "42 00 04 06",
    ),
    "reading mapped to be received": (
        ["23 00 14 01 01 02 00 80", "2F 00 16 00 00 00 00 00", "23 00 16 01 10 01 81 63"],
        "41 00 04 06",
    ),
}


@pytest.mark.parametrize(("requests", "abort"), REMAP.values(), ids=REMAP.keys())
def test_mapping_rules(bench, requests, abort):
    *before, last = [bench.sdo(request) for request in requests]
    assert all(answer.startswith("60") for answer in before)
    assert last.startswith("80")
    assert last.endswith(abort)


def test_remapped_pdo_is_sent(bench):
    """Reading first, then the status word, under another identifier."""
    for request in (
        OFF,
        CLEAR,
        "23 00 1A 01 10 01 81 63",
        "23 00 1A 02 10 00 41 60",
        "2F 00 1A 00 02 00 00 00",
        "23 00 18 01 A1 01 00 00",
    ):
        assert bench.sdo(request).startswith("60")
    bench.send(frames.nmt(NmtCommand.START, 1))
    sent = [str(f) for f in ticks(bench, 1)]
    assert [text for text in sent if text.startswith("1A1 [4]") and text.endswith("08 00")]
    assert not [text for text in sent if text.startswith("181")]


def test_every_second_sync(bench):
    bench.sdo("2F 00 18 02 02 00 00 00")
    bench.send(frames.nmt(NmtCommand.START, 0))
    assert len([f for f in ticks(bench, 10) if f.can_id == 0x181]) == 5


# -- PDO ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", [None, NmtCommand.STOP, NmtCommand.PRE_OPERATIONAL])
def test_pdos_in_operational_only(bench, command):
    if command is not None:
        bench.send(frames.nmt(NmtCommand.START, 0))
        bench.send(frames.nmt(command, 1))
    assert ticks(bench, 30, Frame(0x201, b"\x01\x00\x00\x00")) == []
    assert bench.world.nodes[0].valve.state is S.INIT


def test_stopped_node_answers_nmt_only(bench):
    bench.send(frames.nmt(NmtCommand.STOP, 1))
    assert bench.sdo("40 00 10 00 00 00 00 00") == ""
    bench.send(frames.nmt(NmtCommand.PRE_OPERATIONAL, 1))
    assert bench.sdo("40 00 10 00 00 00 00 00") != ""


def test_nmt_for_another_node(bench):
    for data in (b"\x01\x02", b"\x01", b"\x01\x01\x01", b"\x33\x01"):
        bench.send(Frame(0x000, data))
    assert bench.world.nodes[0].state is NmtState.PRE_OPERATIONAL


def test_set_point_takes_effect_at_the_next_sync(running):
    valve = running.world.nodes[0].valve
    running.send(Frame(0x201, bytes((7, 0)) + (1000).to_bytes(2, "little")))
    assert valve.demand_pa() == 50e3
    running.send(frames.SYNC)
    assert valve.demand_pa() == 10e3


def test_asynchronous_set_point_takes_effect_at_once(running):
    running.sdo("2F 00 14 02 FE 00 00 00")
    running.send(Frame(0x201, bytes((7, 0)) + (1000).to_bytes(2, "little")))
    assert running.world.nodes[0].valve.demand_pa() == 10e3


def test_event_driven_pdo(bench):
    """TPDO 2 by default: every 100 ms error register, supply 150 kPa, 25 degrees."""
    bench.send(frames.nmt(NmtCommand.START, 0))
    sent = [str(f) for f in ticks(bench, 100) if f.can_id == 0x281]
    assert sent == ["281 [5] 00 DC 05 FA 00"] * 5
    running = bench.world.nodes[0]
    running.dictionary.values[0x1801, 3] = 500  # no more than one in 50 ms
    running.dictionary.values[0x2100, 2] = 251
    assert [str(f) for f in ticks(bench, 5) if f.can_id == 0x281] == ["281 [5] 00 DC 05 FB 00"]


def test_short_set_point_is_reported_and_ignored(running):
    sent = ticks(running, 1, Frame(0x201, b"\x07\x00\x10"))
    assert emergencies(sent) == ["8210"]
    assert running.world.nodes[0].valve.demand_pa() == 50e3


def test_limits_of_the_device_hold_whatever_is_sent(running):
    ticks(running, 1, Frame(0x201, bytes((7, 0)) + (32767).to_bytes(2, "little")))
    valve = running.world.nodes[0].valve
    assert valve.demand_pa() == 90e3
    status = ticks(running, 1)[0].data[:2]
    assert int.from_bytes(status, "little") & 1 << 10, "limit touched"


# -- the valve ------------------------------------------------------------------------------------

DEMANDS = dict.fromkeys(S) | {S.ACTIVE: 50e3, S.HOLD: 3e3, S.FAULT_HOLD: 3e3}


@pytest.mark.parametrize(("state", "demand"), list(DEMANDS.items()))
def test_what_the_valve_does_in_each_state(bench, state, demand):
    """It follows 6380 in ACTIVE, 6394 in HOLD and FAULT_HOLD, and vents otherwise; None is venting."""
    bench.sdo("2B 94 63 01 2C 01 00 00")
    bench.sdo("2B 80 63 01 88 13 00 00")
    valve = bench.world.nodes[0].valve
    valve.state = state
    assert valve.demand_pa() == demand
    answer = bench.sdo("40 41 60 00 00 00 00 00")
    assert int(answer.split()[4], 16) & 0xF == state.bits


def test_hysteresis_keeps_an_active_valve_off_zero_but_not_a_venting_one(running):
    for _ in range(200):
        running.exchange(0.0)
    assert running.world.pressure_pa[0] == pytest.approx(450.0, abs=1.0)
    running.world.nodes[0].fault(0x8302, 1, S.FAULT_DISABLED)
    ticks(running, 200)
    assert running.world.pressure_pa[0] < 1.0


# -- watchdogs ------------------------------------------------------------------------------------


def test_heartbeat_consumer_starts_with_the_first_heartbeat(bench):
    bench.sdo("23 16 10 01 64 00 7F 00")
    assert emergencies(ticks(bench, 100)) == []
    bench.send(frames.heartbeat(126, NmtState.OPERATIONAL))  # of another node
    assert emergencies(ticks(bench, 100)) == []
    bench.send(HEARTBEAT)
    assert emergencies(ticks(bench, 19)) == []
    assert emergencies(ticks(bench, 1)) == ["8130"]
    assert emergencies(ticks(bench, 100)) == [], "reported once"


def test_silent_host_vents(running):
    sent = ticks(running, 100, Frame(0x201, bytes((7, 0)) + (5000).to_bytes(2, "little")))
    assert emergencies(sent) == ["8130"]
    assert running.world.nodes[0].valve.state is S.FAULT_DISABLED
    assert running.world.pressure_pa[0] < 100.0


def test_missing_set_points_vent(running):
    sent = ticks(running, 8, HEARTBEAT)
    assert emergencies(sent) == []
    sent = ticks(running, 100, HEARTBEAT)
    assert emergencies(sent) == ["8250"]
    assert running.world.nodes[0].valve.state is S.FAULT_DISABLED
    assert running.world.pressure_pa[0] < 100.0


@pytest.mark.parametrize(
    ("behaviour", "state"),
    [(0, NmtState.PRE_OPERATIONAL), (1, NmtState.OPERATIONAL), (2, NmtState.STOPPED)],
)
def test_error_behaviour(running, behaviour, state):
    running.sdo(f"2F 29 10 01 0{behaviour} 00 00 00")
    ticks(running, 60)
    assert running.world.nodes[0].state is state
    assert running.world.nodes[0].valve.state is S.FAULT_DISABLED


def test_fault_passes_through_its_reaction(running):
    node = running.world.nodes[0]
    node.fault(0x2320, 1, S.FAULT_INIT)
    node.fault(0x3120, 1, S.FAULT_HOLD)  # a second one while the first lasts changes nothing
    nibbles = [f.data[0] & 0xF for f in ticks(running, 4, HEARTBEAT) if f.can_id == 0x181]
    assert nibbles == [0b0111, 0b0111, 0b0000, 0b0000]
    assert node.dictionary.values[0x1001, 0] == 1


def test_all_clear_follows_a_reset_edge(running):
    running.world.nodes[0].fault(0x2320, 1, S.FAULT_INIT)
    ticks(running, 4, HEARTBEAT)
    sent = ticks(running, 1, HEARTBEAT, Frame(0x201, b"\x08\x00\x00\x00"))
    assert emergencies(sent) == ["0000"]
    assert running.world.nodes[0].valve.state is S.INIT
    assert running.world.nodes[0].dictionary.values[0x1001, 0] == 0


def test_heartbeats_are_on_their_grid(bench):
    bench.sdo("2B 17 10 00 19 00 00 00")
    bench.send(frames.nmt(NmtCommand.START, 0))
    sent = [str(f) for f in ticks(bench, 200) if f.can_id == 0x701]
    assert sent == ["701 [1] 05"] * 40


# -- boot -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "setpoint"), [(NmtCommand.RESET_NODE, 0), (NmtCommand.RESET_COMMUNICATION, 5000)]
)
def test_reset_boots_and_forgets(running, command, setpoint):
    running.bus._frames.clear()
    running.send(frames.nmt(command, 1))
    assert [str(f) for f in running.bus._frames] == ["701 [1] 00"]
    node = running.world.nodes[0]
    assert node.state is NmtState.PRE_OPERATIONAL
    assert node.valve.state is S.INIT
    assert node.dictionary.values[0x1017, 0] == 0
    assert node.dictionary.values[0x6380, 1] == setpoint, "the application keeps its values"
    assert emergencies(ticks(running, 60)) == []
    assert running.world.pressure_pa[0] < 200.0


def test_boot_takes_its_time_in_real_time():
    heard = []
    world = World(single(emulation={"boot_delay_s": 0.1}), heard.append, lockstep=False)
    for time_ms in range(0, 99, 3):
        world.run(time_ms * 1_000_000)
    world.host_sends(frames.sdo_read(1, 0x1000, 0))
    assert heard == []
    world.run(110_000_000)
    assert [str(f) for f in heard] == ["701 [1] 00"]


# -- the bus --------------------------------------------------------------------------------------


def test_lowest_identifier_first_and_never_to_its_sender():
    hub = Hub(1_000_000)
    log = []
    a = hub.attach(lambda frame, time_ns: log.append(("a", frame.can_id, time_ns)))
    b = hub.attach(lambda frame, time_ns: log.append(("b", frame.can_id, time_ns)))
    hub.send(a, Frame(0x300), 0)
    hub.send(a, Frame(0x080), 0)  # behind 300 in the same adapter
    hub.send(b, Frame(0x200), 0)
    hub.send(b, Frame(0x100), 60_000)
    hub.run(1_000_000)
    assert log == [("a", 0x200, 55_000), ("b", 0x300, 110_000), ("b", 0x080, 165_000), ("a", 0x100, 220_000)]


def test_bus_is_paced():
    """12 single valves need 2335 bits a cycle: 428 cycles a second are the most that 1 Mbit/s carries."""
    valves = [{"chamber": f"link0/chamber{n}", "node": n + 1} for n in range(12)]
    done = []
    world = World(
        platform(valves=valves, emulation={"boot_delay_s": 0.0}),
        lambda frame: done.append((world.now_ns, frame.can_id)),
        lockstep=False,
    )
    world.run(20_000_000)
    world.host_sends(frames.nmt(NmtCommand.START, 0))
    world.run(21_000_000)
    for node in world.nodes:
        node.dictionary.values[0x1801, 1] |= 1 << 31
    done.clear()
    start = world.now_ns
    for n in range(1, 13):
        world.host_sends(Frame(0x200 + n, bytes(4)))
    world.host_sends(frames.SYNC)
    world.run(start + 10_000_000)
    assert [can_id for _, can_id in done] == list(range(0x181, 0x18D))
    assert done[-1][0] - start == 2_335_000


def test_full_transmit_queue_loses_frames():
    hub = Hub(10_000)
    port = hub.attach(lambda *_: None)
    for _ in range(300):
        hub.send(port, Frame(1, bytes(8)), 0)
    assert port.overruns == 300 - 256


def test_stalled_process_does_not_age_the_world():
    world = World(single(), lambda frame: None, lockstep=False)
    assert world.run(10_000_000) == 0
    assert world.run(5_000_000_000) == 4_970_000_000
    assert world.now_ns == 30_000_000


def test_real_time_world_publishes_each_step():
    world = World(single(), lambda frame: None, lockstep=False)
    published = []
    world.on_tick = lambda time_ns, pressures: published.append((time_ns, pressures.shape))
    for time_ms in range(1, 26):
        world.run(time_ms * 1_000_000)
    assert published == [(2_500_000 * n, (1,)) for n in range(1, 11)]


def test_lockstep_advances_by_the_period_that_was_written(bench):
    ticks(bench, 1)
    assert bench.world.now_ns == 5_000_000, "that of the platform as long as 1006 is 0"
    bench.sdo("23 06 10 00 D0 07 00 00")
    ticks(bench, 1)
    assert bench.world.now_ns == 7_000_000


def test_readings_of_one_sync_belong_together():
    bench = Bench(platform(emulation={"regulator": {"reading_noise_pa": 0.0}}))
    bench.driver.configure()
    for _ in range(50):
        before = bench.world.pressure_pa.copy()
        result = bench.exchange(20e3, 40e3, 60e3)
        np.testing.assert_allclose(result.pressure_pa, before, atol=51.0)
