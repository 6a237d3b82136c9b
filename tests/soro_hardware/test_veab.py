"""The VEAB client on the published server, with that server's faults, in lockstep."""

import math
import struct

import numpy as np
import pytest
from board_bench import QUIET, VEAB, VeabBench, file_of, veab_platform
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.errors import ConfigError, HardwareError
from soro_core.safety import Limits
from soro_hardware import load_platform
from soro_hardware.emulation.veab import EmulatedVeabServer
from soro_hardware.limited_regulator import LimitedRegulator
from soro_hardware.port import FAULT_CODES
from soro_hardware.veab import protocol
from tests.refused import fails
from tests.soro_hardware.line_link import LineLink

HELD = 50e3


@pytest.fixture
def bench():
    """Three valves at 20, 40 and 60 kPa."""
    bench = VeabBench(veab_platform())
    bench.driver.configure()
    assert bench.run(100, 20e3, 40e3, 60e3).faults == ()
    return bench


def codes(result, latched=True):
    return {fault.code for fault in result.faults if fault.latched is latched}


def run_alone(bench, seconds):
    """Let time pass for the valves, without a word of the host."""
    for _ in range(round(seconds / 0.005)):
        bench.devices.tick(bench.devices.now_ns + 5_000_000)


# -- protocol --------------------------------------------------------------------------------------


def test_bytes():
    assert protocol.encode([0.0, 50e3, -100e3, 100e3]) == struct.pack("<4d", 0.5, 0.75, 0.0, 1.0)
    assert protocol.encode([0.0]) == bytes.fromhex("000000000000E03F")
    taken = protocol.ReadingDecoder(2)
    assert taken.feed(struct.pack("<2d", 5.0, 7.5)) == [(0.0, 50e3)]


def test_set_points_beyond_the_span_end_at_it():
    assert [protocol.normalised(p) for p in (-1e9, -100e3, 1e9)] == [0.0, 0.0, 1.0]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_never_encoded(bad):
    with pytest.raises(ValueError, match="finite"):
        protocol.encode([0.0, bad])


def test_any_split_of_the_stream():
    rows = [(0.0, 20e3, 40e3), (100.0, -5e3, 90e3)] * 3
    stream = b"".join(struct.pack("<3d", *map(protocol.volts, row)) for row in rows)
    for step in range(1, len(stream)):
        taken = protocol.ReadingDecoder(3)
        found = [r for at in range(0, len(stream), step) for r in taken.feed(stream[at : at + step])]
        np.testing.assert_allclose(found, rows, atol=1e-9)
        assert taken.broken is None


@pytest.mark.parametrize("lost", range(1, 8))
def test_a_stream_off_its_beat_is_noticed_in_the_first_reading(lost):
    """Whatever number of bytes is missing, and whatever the counts of the converter are."""
    rng = np.random.default_rng(lost)
    for _ in range(200):
        counts = rng.integers(1, 2001, 12) * 0.005
        taken = protocol.ReadingDecoder(4)
        assert taken.feed(counts.tobytes()[lost:]) == []
        assert taken.broken is not None
        assert taken.feed(counts.tobytes()) == [], "nothing is decoded until the connection is new"
        taken.reset()
        assert len(taken.feed(counts.tobytes())) == 3


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 10.6, 1e-200, -1e300])
def test_impossible_voltages(value):
    taken = protocol.ReadingDecoder(2)
    assert taken.feed(struct.pack("<4d", 5.0, 5.0, 5.0, value)) == [(0.0, 0.0)]
    assert taken.broken.endswith("V on port 1")


def test_fuzz():
    """20 000 pieces of readings and garbage: no crash, and nothing impossible gets through."""
    rng = np.random.default_rng(12)
    taken = protocol.ReadingDecoder(4)
    breaks = waiting = 0
    for _ in range(20_000):
        piece = (rng.integers(0, 2048, 4) * 0.005).astype("<f8").tobytes()
        if rng.random() < 0.3:
            piece = rng.bytes(int(rng.integers(1, 60)))
        readings = taken.feed(piece)
        for reading in readings:
            assert all(-110e3 <= value <= 110e3 for value in reading)
        waiting += len(piece) - 32 * len(readings)
        if taken.broken is not None:
            breaks, waiting = breaks + 1, 0
            taken.reset()
        assert 0 <= waiting < 32, "each reading once, as soon as its last byte is there"
    assert breaks > 5000


# -- the published server --------------------------------------------------------------------------


def published_client(bench):
    """A client that sends set points and leaves, as the published examples do."""
    link = LineLink(bench.devices.line)
    link.open()
    for _ in range(100):
        link.send(protocol.encode([HELD] * 4))
    return link


@pytest.mark.parametrize("end", ["leaves", "short message", "killed"])
def test_the_published_vent_does_nothing(end):
    """What we must live with: however the server ends, its reset of the DACs writes nothing."""
    bench = VeabBench(veab_platform())
    link = published_client(bench)
    if end == "leaves":
        link.close()
    elif end == "short message":
        link.send(b"\x00" * 12)
    else:
        bench.devices.end("killed")
    assert bench.devices.ended is not None
    run_alone(bench, 10.0)
    np.testing.assert_allclose(bench.devices.pressure_pa, HELD, atol=600.0)
    with fails(HardwareError, code="open"):
        link.open()


def test_the_published_server_ends_after_half_a_second_of_silence():
    bench = VeabBench(veab_platform())
    devices = EmulatedVeabServer(bench.driver.platform, lockstep=False)
    link = LineLink(devices.line)
    link.open()
    link.send(protocol.encode([HELD] * 4))
    for now_ms in range(0, 500, 10):
        devices.run(now_ms * 1_000_000)
    assert devices.ended is None
    for now_ms in range(500, 1000, 10):
        devices.run(now_ms * 1_000_000)
    assert devices.ended == "timed out"
    np.testing.assert_allclose(devices.pressure_pa, HELD, atol=600.0)


def test_our_close_empties_the_arm_before_it_leaves(bench):
    """The regression test: leaving is what makes that server hold the pressure."""
    bench.driver.close()
    assert bench.driver.seen_empty
    assert bench.devices.ended == "the client has left"
    run_alone(bench, 10.0)
    assert np.abs(bench.devices.pressure_pa).max() < 500.0


def test_our_vent_is_sent_and_confirmed(bench):
    bench.driver.vent()
    assert [dac.normalized_value for dac in bench.devices.dacs] == [0.5] * 4
    assert not bench.driver.seen_empty
    assert bench.run(60, 0.0).faults == ()
    assert bench.driver.seen_empty


def test_a_vent_that_does_not_empty_the_arm_is_told_and_no_start_up_goes_past_it(bench):
    for dac in bench.devices.dacs[1:2]:
        dac.__class__ = type("Stuck", (type(dac),), {"__setattr__": lambda *_: None})
    loop = LimitedRegulator(bench.driver.platform, bench.driver, Limits())
    loop.vent("asked for")
    for cycle in range(403):
        loop.cycle(cycle * 5_000_000)
        assert (loop.not_vented is None) == (cycle < 400)
    assert loop.not_vented.startswith("link0/chamber1 still at ")
    with fails(HardwareError, "2 s", device="link0/chamber1 (port 1)", step="start-up", code="pressure"):
        bench.driver.configure()
    bench.driver.close()
    assert not bench.driver.seen_empty


def test_start_up_vents_what_a_dead_server_has_held():
    bench = VeabBench(veab_platform())
    published_client(bench).close()
    bench.devices.start()
    np.testing.assert_allclose(bench.devices.pressure_pa, HELD, atol=600.0)
    bench.driver.configure()
    assert np.abs(bench.devices.pressure_pa).max() < 5e3


# -- the driver ------------------------------------------------------------------------------------


def test_unused_ports_stay_at_zero(bench):
    assert bench.devices.dacs[3].normalized_value == 0.5


def test_server_gone(bench):
    bench.devices.end("killed")
    result = bench.exchange(20e3)
    assert codes(result) == {"link_lost"}
    assert not result.fresh.any()
    result = bench.run(10, 20e3)
    assert codes(result, latched=False) == {"stale_reading"}
    assert not result.sent_pa.any()
    with fails(HardwareError, code="open"):
        bench.driver.configure()
    bench.driver.vent()
    bench.driver.close()


def test_an_arm_that_was_seen_empty_stays_so_when_the_server_goes_before_the_driver(bench):
    assert bench.run(60, 0.0).faults == ()
    bench.devices.end("killed")
    bench.driver.close()
    assert bench.driver.seen_empty


def test_restarted_server_is_given_zeros_until_the_start_up(bench):
    """Coming back by itself is what vents the arm: the DACs have kept their voltages."""
    bench.devices.end("killed")
    bench.run(10, 60e3)
    np.testing.assert_allclose(bench.devices.pressure_pa, [20e3, 40e3, 60e3], atol=600.0)
    bench.devices.start()
    result = bench.run(60, 60e3)
    assert codes(result) == {"link_lost"}
    assert result.fresh.all()
    assert np.abs(bench.devices.pressure_pa).max() < 1e3
    bench.driver.configure()
    assert bench.run(100, 60e3).faults == ()
    np.testing.assert_allclose(bench.devices.pressure_pa, 60e3, atol=600.0)


def test_out_of_sync_vents_before_the_connection_is_given_up(bench):
    """Giving it up ends the server: 0 Pa must have reached the DACs before."""
    bench.devices.line.put(b"\x40")  # one byte too many
    seen = []
    while bench.devices.ended is None:
        result = bench.exchange(60e3)
        seen.append((codes(result), {dac.normalized_value for dac in bench.devices.dacs[:3]}))
    assert [codes for codes, _ in seen][-1] == {"out_of_sync"}
    assert seen[-1][1] == {0.5}
    assert bench.driver.statistics.frames_garbled == 1
    run_alone(bench, 1.0)
    assert np.abs(bench.devices.pressure_pa).max() < 500.0
    bench.devices.start()
    assert codes(bench.run(20, 60e3)) == {"out_of_sync"}
    bench.driver.configure()
    assert bench.run(10, 60e3).faults == ()


@pytest.mark.timeout(120)
def test_a_server_that_never_stops_sending_holds_nothing_up(bench, monkeypatch):
    """Whoever sends faster than it can be read would keep the vent waiting for the end of it."""
    reading = struct.pack("<12d", *[5.0] * 12)
    with monkeypatch.context() as flood:
        flood.setattr(LineLink, "receive", lambda link, timeout_s: reading)
        bench.driver.vent()
        result = bench.exchange(20e3)
        assert codes(result) == {"out_of_sync"}
        assert "without a pause" in result.fault_text
        assert not result.sent_pa.any()
    bench.driver.close()


@pytest.mark.parametrize("period_ms", [1, 20])
def test_the_server_has_time_to_write_before_the_connection_is_given_up(period_ms):
    """Its rounds of 4 ms are its own, at any rate of ours."""
    bench = VeabBench(veab_platform(host={"stale_cycles": 100}))
    bench.driver.configure()
    devices = EmulatedVeabServer(bench.driver.platform, lockstep=False)
    devices.line.connected(True)
    bench.link.line = devices.line
    for now_ms in range(0, 600, period_ms):
        devices.run(now_ms * 1_000_000)
        if now_ms == 400:
            assert devices.pressure_pa[0] > 50e3
            devices.line.put(b"\x40")
        bench.driver.exchange(np.full(3, 60e3), now_ms * 1_000_000)
        if devices.ended is not None:
            break
    assert devices.ended == "the client has left"
    assert {dac.normalized_value for dac in devices.dacs} == {0.5}


def test_lost_readings_are_stale_after_some_cycles(bench):
    bench.devices.line.to_host = lambda chunk: b""
    assert bench.run(4, 20e3).faults == ()
    result = bench.exchange(20e3)
    assert codes(result, latched=False) == {"stale_reading"}
    assert not result.fresh.any()
    bench.devices.line.to_host = lambda chunk: chunk
    result = bench.exchange(20e3)
    assert result.faults == ()
    assert result.fresh.all()
    assert bench.driver.statistics.frames_lost == 5


def test_a_server_that_sends_nothing_is_named():
    bench = VeabBench(veab_platform(host={"vent_timeout_s": 0.05}))
    bench.devices.line.to_host = lambda chunk: b""
    with fails(HardwareError, step="start-up", code="silent"):
        bench.driver.configure()


def test_configure_keeps_a_connection_that_is_in_order(bench):
    bench.driver.configure()
    assert bench.devices.ended is None
    assert bench.run(5, 20e3).faults == ()


def test_configure_notices_that_the_server_has_gone(bench):
    bench.run(200, 0.0)
    bench.devices.end("killed")
    with fails(HardwareError, code="open"):
        bench.driver.configure()


FLOATS = st.floats(allow_nan=True, allow_infinity=True) | st.floats(0.0, 90e3)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.lists(st.tuples(FLOATS, FLOATS, FLOATS), max_size=20))
def test_what_goes_over_the_wire_is_within_range_for_any_set_points(sequence):
    bench = VeabBench(veab_platform(**QUIET))
    bench.driver.configure()
    bench.link.take_log()
    for setpoints in sequence:
        result = bench.exchange(*setpoints)
        assert {fault.code for fault in result.faults} <= set(FAULT_CODES)
    sent = [struct.unpack("<4d", data) for mark, data in bench.link.take_log() if mark == ">"]
    assert len(sent) == len(sequence)
    assert all(0.5 - 1e-6 <= value <= 0.95 + 1e-6 for message in sent for value in message)
    for message, setpoints in zip(sent, sequence, strict=True):
        if not all(-0.1 <= value <= 90e3 + 0.1 for value in setpoints):
            assert message == (0.5,) * 4


BAD = {
    "port that is not there": ({"ports": 2}, ("", "valves:", "0", "1", "2")),
    "port twice": (
        {"valves": [{"chamber": f"link0/chamber{n}", "port": 1} for n in (0, 1)]},
        ("", "valves:", "once", "1"),
    ),
    "range": ({"range": {"maximum_pa": 125e3}}, ("", "range:", "rating")),
    "keep alive too slow": ({"host": {"keep_alive_s": 0.6}}, ("host.keep_alive_s", "0.6")),
    "no server": ({"transport": {"kind": "slcan"}}, ("transport.kind", "'slcan'")),
}


@pytest.mark.parametrize(("change", "found"), BAD.values(), ids=BAD.keys())
def test_bad_platform(change, found, tmp_path):
    """The thesis simulates 125 kPa; its valves end at 100 kPa."""
    with fails(ConfigError, *found[1:], key=found[0]):
        load_platform(file_of(tmp_path, VEAB, **change))


@pytest.mark.parametrize("call", ["vent", "exchange"])
def test_a_connection_lost_in_any_call_is_latched(bench, call):
    """It must not come back by itself as if nothing had been."""
    bench.devices.end("killed")
    bench.devices.start()
    if call == "vent":
        bench.driver.vent()
    result = bench.run(3, 60e3)
    assert codes(result) == {"link_lost"}
    assert not result.sent_pa.any()
