"""Faults of emulated devices: words, times, and what they do to bytes, frames, air and readings."""

import numpy as np
import pytest
from hardware_bench import Bench, codes, platform
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.errors import ConfigError
from soro_core.pneumatics.regulator import RegulatorModel
from soro_hardware.emulation.canopen.hub import Hub
from soro_hardware.emulation.faults.air_faults import PNEUMATIC, SENSOR, faulty_pressure, faulty_reading
from soro_hardware.emulation.faults.fault_types import KINDS, OF_ALL, Injection, read_injection
from soro_hardware.emulation.faults.line_faults import ON_BYTES, LineFaults
from soro_hardware.emulation.faults.schedule import FaultSchedule
from soro_hardware.emulation.line import Line
from soro_hardware.emulation.sockets.control import answer_to
from soro_hardware.transport.frame import Frame
from tests.refused import fails

S = 1_000_000_000
CHAMBERS = ("link0/chamber0", "link0/chamber1", "link0/chamber2")
VALVE = RegulatorModel()
RNG = np.random.default_rng(0)


def faults(*texts, seed=0):
    it = FaultSchedule(seed)
    it.chambers = CHAMBERS
    for text in texts:
        it.add(read_injection(text))
    return it


# Words ----------------------------------------------------------------------------------------------


def test_a_fault_reads_as_it_is_written():
    text = "{at: 5.0, fault: leak, chamber: link0/chamber1, duration_s: 2, rate_1_s: 3e1}"
    fault = read_injection(text)
    assert fault == Injection(at=5.0, fault="leak", chamber="link0/chamber1", duration_s=2.0, value=30.0)
    assert read_injection(text[1:-1]) == fault
    assert read_injection(fault.as_text()) == fault


@given(st.sampled_from(sorted(KINDS)), st.floats(0, 1), st.floats(0, 100), st.floats(0, 100))
def test_every_word_survives_the_way_through_text(name, part, at, lasts):
    kind = KINDS[name]
    value = kind.low + part * (kind.high - kind.low) if kind.key else None
    chamber = "" if kind.group in OF_ALL else "link1/chamber2"
    fault = Injection(at=at, fault=name, chamber=chamber, duration_s=lasts, value=value)
    assert read_injection(fault.as_text()) == fault


def test_defaults_of_parameters_are_within_their_bounds():
    for kind in KINDS.values():
        assert kind.low <= kind.default <= kind.high
        assert bool(kind.key) == (kind.high > kind.low)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("fault: jam", ("", "fault:", "drop", "corrupt_bits")),
        ("fault: leak", ("", "leak:", "link0/chamber0")),
        ("fault: drop, chamber: link0/chamber0", ("", "drop:", "chamber")),
        ("fault: reboot, chamber: link0/chamber0, value: 1", ("", "reboot:", "value")),
        ("fault: drop, p: 2", ("", "drop:", "0", "1")),
        ("fault: drop, at: -1", ("at", "0")),
        ("fault: drop, p: .nan", ("value", "finite")),
        ("fault: drop, rate_1_s: 1", ("", "drop:", "0", "1", "rate_1_s")),
        ("fault: leak, chamber: link0/chamber0, p: 1", ("", "leak:", "rate_1_s", "1000", "not p")),
        ("fault: reboot, chamber: link0/chamber0, p: 1", ("", "reboot:", "not p")),
        ("fault: drop, p: much", ("", "drop:", "number")),
        ("fault: drop, p: true", ("", "drop:", "number")),
        ("at: 1", ("", "'at: 1'", "'fault: leak, chamber: link0/chamber0'")),
        ("drop", ("", "'drop'", "'fault: leak, ")),
        ("[1]", ("", "name")),
        ("fault: [drop]", ("fault", "string")),
        ("{", ("", "YAML")),
    ],
)
def test_a_wrong_one_is_refused_in_one_line(text, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        read_injection(text)


def test_what_a_family_or_a_platform_has_not_is_refused():
    it = FaultSchedule(supported={"leak"})
    it.chambers = CHAMBERS
    with fails(ConfigError, "leak"):
        it.add(Injection(fault="drop"))
    with fails(ConfigError, "link0/chamber0, "):
        it.add(Injection(fault="leak", chamber="link4/chamber0"))


# Time -----------------------------------------------------------------------------------------------


def test_schedule():
    it = faults(
        "at: 2, fault: leak, chamber: link0/chamber1, duration_s: 1",
        "at: 1, fault: burst, chamber: link0/chamber1",
    )
    started, ended = [], []
    it.on_start = {"leak": lambda f: started.append(f.fault), "burst": lambda f: started.append(f.fault)}
    it.on_end = {"leak": lambda f: ended.append(f.fault)}
    assert it.of(1) == {}
    it.advance(S - 1)
    assert not it.active
    it.advance(S)
    assert it.of(1) == {"burst": 500.0}
    it.advance(2 * S)
    assert it.of(1) == {"burst": 500.0, "leak": 2.0}
    assert it.of(0) == {}
    it.advance(3 * S)
    assert it.of(1) == {"burst": 500.0}
    assert (started, ended) == (["burst", "leak"], ["leak"])


def test_injected_later_counts_from_then():
    it = faults()
    it.advance(10 * S)
    it.add(Injection(fault="drop", at=1.0))
    it.advance(11 * S - 1)
    assert it.value("drop") is None
    it.advance(11 * S)
    assert it.value("drop") == 0.2


def test_what_waits_is_listed_with_what_is_active():
    it = faults("fault: leak, chamber: link0/chamber1", "fault: drop, at: 5")
    it.advance(2 * S)
    assert answer_to(it, "list") == "ok: leak of link0/chamber1 (rate_1_s 2); drop (p 0.2) in 3.0 s"
    assert answer_to(it, "fault: clear") == "ok: clear"
    assert answer_to(it, "list") == "ok: no faults"


def test_clear_of_a_chamber_and_of_all():
    it = faults(
        "fault: leak, chamber: link0/chamber0", "fault: leak, chamber: link0/chamber1", "fault: drop, at: 5"
    )
    it.add(Injection(fault="clear", chamber="link0/chamber0"))
    assert [f.chamber for f in it.active] == ["link0/chamber1"]
    it.add(Injection(fault="clear"))
    it.advance(6 * S)
    assert not it.active


# Air ------------------------------------------------------------------------------------------------


def pressure(active, before=40e3, target=40e3, venting=False, dt=0.5, model=VALVE):
    return faulty_pressure(active, model, before, target, venting, dt)


def test_pneumatic_faults():
    assert pressure({}, before=0.0, dt=0.052) == pytest.approx(40e3 * (1 - np.exp(-1)))
    assert pressure({"stuck_open": 150e3}) == pytest.approx(150e3, rel=1e-3)
    assert pressure({"stuck_closed": 0.0}, target=0.0) == 40e3
    assert pressure({"stuck_at": 30e3}) == pytest.approx(30e3, rel=1e-3)
    assert pressure({"slow_valve": 10.0}, target=0.0, dt=0.52) == pytest.approx(40e3 * np.exp(-1))
    assert pressure({"slow_valve": 10.0}, target=0.0, dt=0.52, venting=True) == pytest.approx(
        40e3 * np.exp(-10)
    )
    assert pressure({"kinked_line": 10.0}, target=0.0, dt=0.52, venting=True) == pytest.approx(
        40e3 * np.exp(-1)
    )
    assert pressure({"leak": 2.0, "stuck_closed": 0.0}, dt=1.0) == pytest.approx(40e3 * np.exp(-2))
    assert pressure({"leak": 2.0}, dt=5.0) == pytest.approx(40e3 / (1 + 2 * 0.052))
    assert pressure({"burst": 500.0}) < 2e3
    assert pressure({"supply_drop": 20e3}) == pytest.approx(20e3, rel=1e-3)
    assert pressure({"vent_blocked": 0.0}, target=0.0) == 40e3
    assert pressure({"vent_blocked": 0.0}, target=60e3) > 59e3


@given(
    st.dictionaries(st.sampled_from(sorted(PNEUMATIC)), st.floats(1.0, 100e3), max_size=4),
    st.floats(-50e3, 150e3),
    st.floats(-50e3, 150e3),
    st.booleans(),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)
def test_two_steps_are_one(active, before, target, venting, first, second):
    halves = pressure(active, pressure(active, before, target, venting, first), target, venting, second)
    whole = pressure(active, before, target, venting, first + second)
    assert halves == pytest.approx(whole, rel=1e-6, abs=1e-3)


def reading(active, pa=40e3, held=12e3):
    return faulty_reading(active, pa, held, RNG)


def test_sensor_faults():
    assert reading({}) == 40e3
    assert reading({"sensor_offset": 5e3}) == 45e3
    assert reading({"sensor_scale": 1.5}) == 60e3
    assert reading({"sensor_stuck": 0.0}) == 12e3
    assert reading({"sensor_saturate": 20e3}) == 20e3
    assert reading({"sensor_quantise": 3e3}) == 39e3
    assert reading({"sensor_open_circuit": -125e3, "sensor_stuck": 0.0}) == -125e3
    noisy = [reading({"sensor_noise": 2e3}) for _ in range(400)]
    assert np.std(noisy) == pytest.approx(2e3, rel=0.15)


def test_faults_of_a_running_arm_strike_their_chamber_alone():
    bench = Bench(platform())
    bench.driver.configure()
    bench.run(100, 20e3, 40e3, 60e3)
    bench.world.faults.add(Injection(fault="stuck_at", chamber=CHAMBERS[1], value=10e3))
    bench.world.faults.add(Injection(fault="sensor_stuck", chamber=CHAMBERS[0]))
    before = bench.exchange(20e3, 40e3, 60e3).pressure_pa[0]
    result = bench.run(100, 30e3, 40e3, 60e3)
    np.testing.assert_allclose(bench.world.pressure_pa, [30e3, 10e3, 60e3], atol=600.0)
    assert result.pressure_pa[0] == before
    bench.world.faults.clear()
    assert bench.run(100, 30e3, 40e3, 60e3).faults == ()
    np.testing.assert_allclose(bench.world.pressure_pa, [30e3, 40e3, 60e3], atol=600.0)


def test_every_word_of_the_air_does_something():
    for name in PNEUMATIC:
        active = {name: KINDS[name].default}
        assert any(pressure(active, 30e3, to) != pressure({}, 30e3, to) for to in (0.0, 60e3)), name
    for name in SENSOR:
        assert reading({name: KINDS[name].default}, pa=40.4e3) != 40.4e3, name


# Bytes ----------------------------------------------------------------------------------------------


class Echo(Line):
    """A line that keeps what it takes."""

    def __init__(self):
        super().__init__()
        self.taken = b""

    def take(self, chunk):
        self.taken += chunk


def through(text, messages=(b"one\r", b"two\r", b"three\r", b"four\r"), seed=0, at_s=0.0):
    """What comes out on both sides, and what does later."""
    it, line = faults(text, seed=seed) if text else faults(), Echo()
    passing = LineFaults(it, line)
    for message in messages:
        line.put(message)
        line.feed(message)
    it.advance(round(at_s * S))
    passing.release()
    return bytes(line.output), line.taken


def test_bytes_pass_without_faults():
    assert through("") == (b"one\rtwo\rthree\rfour\r",) * 2


def test_faults_of_bytes():
    assert through("fault: drop, p: 1.0") == (b"", b"")
    assert through("fault: duplicate, p: 1.0", [b"a\r"]) == (b"a\ra\r", b"a\ra\r")
    out, _ = through("fault: corrupt_bits, p: 1.0", [bytes(4)])
    assert sum(byte.bit_count() for byte in out) == 1
    out, _ = through("fault: truncate, p: 1.0", [b"12345"])
    assert b"12345".startswith(out)
    assert len(out) < 5
    out, _ = through("fault: garbage_line, p: 1.0", [b"a\r"])
    assert out.endswith(b"\ra\r")
    assert len(out) > 3
    assert through("fault: delay, delay_s: 0.5", at_s=0.49) == (b"", b"")
    assert through("fault: delay, delay_s: 0.5", at_s=0.5) == (b"one\rtwo\rthree\rfour\r",) * 2
    assert through("fault: reorder, p: 1.0", [b"a\r", b"b\r"])[0] == b"b\ra\r"
    assert through("fault: reorder, p: 1.0", [b"a\r"]) == (b"", b"")
    assert through("fault: reorder, p: 1.0", [b"a\r"], at_s=0.02) == (b"a\r", b"a\r")


@settings(max_examples=50)
@given(st.sampled_from(sorted(ON_BYTES)), st.lists(st.binary(max_size=20), max_size=20), st.integers(0, 5))
def test_any_bytes_pass_any_fault_the_same_way_with_the_same_seed(fault, messages, seed):
    assert through(f"fault: {fault}", messages, seed, 1.0) == through(f"fault: {fault}", messages, seed, 1.0)


# Frames ---------------------------------------------------------------------------------------------


class Wire:
    """A paced bus of a host and two devices that write down what they hear."""

    def __init__(self, *texts, bitrate=1_000_000):
        self.hub, self.heard, self.health = Hub(bitrate), {n: [] for n in range(3)}, []
        self.ports = [
            self.hub.attach(lambda frame, now_ns, n=n: self.heard[n].append((now_ns, frame.can_id)))
            for n in range(3)
        ]
        self.faults = faults()
        self.hub.connect_faults(self.faults, self.ports[0])
        self.host = self.ports[0]
        self.host.report = lambda errors, letter: self.health.append(f"{letter}{errors.state}")
        for text in texts:
            self.faults.add(read_injection(text))

    def send(self, port, *ids, now_ns=0):
        for can_id in ids:
            self.hub.send(self.ports[port], Frame(can_id, bytes(4)), now_ns)

    def ids(self, port):
        return [can_id for _, can_id in self.heard[port]]


def test_a_damaged_frame_is_sent_again_and_counted():
    wire = Wire("fault: corrupt_bits, p: 0.1")
    wire.send(1, *range(0x181, 0x1B1))
    wire.hub.run(S)
    assert wire.ids(0) == list(range(0x181, 0x1B1)), "all of them, in order"
    assert "cactive" in wire.health
    clean = Wire()
    clean.send(1, *range(0x181, 0x1B1))
    clean.hub.run(S)
    assert wire.heard[0][-1][0] > 1.05 * clean.heard[0][-1][0], "repeats take time"


def test_who_is_never_heard_goes_off_the_bus():
    wire = Wire("fault: corrupt_bits, p: 1.0")
    wire.send(0, 0x201)
    wire.send(1, 0x181)
    wire.hub.run(S)
    assert wire.host.errors.is_off
    assert wire.ports[1].errors.is_off
    assert "cbus_off" in wire.health
    wire.faults.clear()
    wire.hub.rejoin(wire.host)
    assert not wire.host.errors.is_off
    wire.send(0, 0x201, now_ns=S)
    wire.send(1, 0x181, now_ns=S)
    wire.hub.run(2 * S)
    assert (wire.ids(0), wire.ids(2)) == ([0x181], [0x201, 0x181])


def test_bus_off_lasts_until_it_is_cleared_and_the_bus_reopened():
    wire = Wire("fault: bus_off")
    wire.hub.rejoin(wire.host)
    assert wire.host.errors.is_off
    wire.send(0, 0x201)
    wire.send(1, 0x181)
    wire.hub.run(S)
    assert (wire.ids(0), wire.ids(2)) == ([], [0x181])
    wire.faults.clear()
    assert wire.host.errors.is_off, "a controller does not come back by itself"
    wire.hub.rejoin(wire.host)
    assert not wire.host.errors.is_off


def test_without_acknowledgement_the_host_is_alone():
    wire = Wire("fault: ack_missing")
    wire.send(0, 0x201)
    wire.send(1, 0x181)
    wire.hub.run(S)
    assert (wire.ids(0), wire.ids(1), wire.ids(2)) == ([], [], [0x181])
    assert set(wire.health) == {"aactive"}


@pytest.mark.parametrize("bitrate", [0, 1_000_000])
def test_who_babbles_starves_those_below_it(bitrate):
    wire = Wire("fault: babble, can_id: 256", bitrate=bitrate)
    wire.send(0, 0x080, 0x201)
    wire.send(1, 0x090, 0x181)
    wire.hub.run(S // 100)
    assert [i for i in wire.ids(0) if i != 256] == [0x090]
    assert [i for i in wire.ids(1) if i != 256] == [0x080]
    wire.faults.clear()
    wire.hub.run(S // 50)
    assert 0x201 in wire.ids(1)
    assert 0x181 in wire.ids(0)


def test_lost_doubled_late_and_swapped_frames():
    for text, ids, at_ns in (
        ("fault: drop, p: 1.0", [], S),
        ("fault: duplicate, p: 1.0", [0x181, 0x181, 0x182, 0x182], S),
        ("fault: delay, delay_s: 0.5", [], S // 2),
        ("fault: delay, delay_s: 0.5", [0x181, 0x182], S),
        ("fault: reorder, p: 1.0", [0x182, 0x181], S),
    ):
        wire = Wire(text)
        wire.send(1, 0x181, 0x182)
        wire.hub.run(at_ns)
        assert wire.ids(0) == ids, text


def test_a_frame_that_is_held_back_and_stays_the_last_one_still_comes():
    wire = Wire("fault: reorder, p: 1.0")
    wire.send(1, 0x181)
    wire.hub.run(S // 100)
    assert wire.ids(0) == []
    wire.hub.run(S // 20)
    assert wire.ids(0) == [0x181]


def test_a_node_with_another_address_is_not_heard_under_its_own():
    bench = Bench(platform())
    bench.driver.configure()
    bench.run(10, 20e3)
    bench.world.faults.add(Injection(fault="wrong_node_id", chamber=CHAMBERS[1], value=99))
    bench.bus.take_log()
    result = bench.run(4, 20e3)
    assert ("stale_reading", "link0/chamber1 (node 2)") in codes(result)
    log = bench.bus.take_log()
    assert not any(line.startswith("< 182") for line in log)
    assert any(line.startswith("< 1E3") for line in log)


def test_brownout_is_reported_then_silent_then_a_reboot():
    bench = Bench(platform())
    bench.driver.configure()
    bench.run(10, 20e3)
    bench.bus.take_log()
    bench.world.faults.add(Injection(fault="brownout", chamber=CHAMBERS[1], duration_s=0.05))
    bench.run(8, 20e3)
    assert [line[:12] for line in bench.bus.take_log() if line[2:5] in ("082", "182", "702")] == [
        "< 082 [8] 20"
    ]
    bench.run(5, 20e3)
    assert "< 702 [1] 00" in bench.bus.take_log()


def test_a_schedule_in_lockstep_is_the_same_every_time():
    def run_once():
        bench = Bench(platform())
        bench.driver.configure()
        for text in ("fault: drop, p: 0.1", "fault: leak, chamber: link0/chamber0, at: 0.3"):
            bench.world.faults.add(read_injection(text))
        return [bench.exchange(20e3, 40e3, 60e3).pressure_pa for _ in range(200)]

    np.testing.assert_array_equal(run_once(), run_once())


def test_injections_are_frozen():
    with fails(ConfigError):
        Injection(fault="drop").fault = "delay"
