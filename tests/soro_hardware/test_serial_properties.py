"""Whatever the caller asks, what reaches the wire is in range; whatever the wire brings, nothing breaks."""

import contextlib
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from serial_bench import SerialBench, alicat, itv, quiet

from soro_hardware.port import FAULT_CODES
from soro_hardware.serial_line import alicat_codec
from soro_hardware.serial_line.itv import is_refusal, parse
from soro_hardware.serial_line.line.request import LineSplitter

NEW, OLD = "10v20.0-R24", "5v12.0-R22"
MAKE = {
    "itv": lambda: SerialBench(itv(2, **quiet())),
    "alicat": lambda: SerialBench(alicat(2, **quiet(firmware=NEW))),
    "alicat old": lambda: SerialBench(alicat(2, **quiet(firmware=OLD))),
}
SET = {
    "itv": re.compile(r"> SET (\d+)"),
    "alicat": re.compile(r"> [AB]LS ([+-]?\d+\.\d\d)"),
    "alicat old": re.compile(r"> [AB]S([+-]?\d+\.\d\d)"),
}
UNIT_PA = {"itv": 1e5 / 1023, "alicat": 1e3, "alicat old": 1e3}
LOWEST, HIGHEST, SLEW = 0.0, 90e3, 400e3

Anything = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(LOWEST, HIGHEST),
    st.sampled_from([0.0, -0.0, HIGHEST, HIGHEST + 1e-6, 1e308, -1.0, float("nan"), float("inf")]),
)


@pytest.mark.parametrize("name", MAKE)
@settings(max_examples=40, deadline=None)
@given(
    commands=st.lists(
        st.tuples(Anything, Anything, st.integers(1, 8), st.booleans()), min_size=1, max_size=12
    )
)
def test_what_reaches_the_wire_is_in_range_and_within_slew(name, commands):
    bench = MAKE[name]()
    bench.driver.configure()
    bench.log()
    for first, second, cycles, is_vented in commands:
        if is_vented:
            bench.driver.vent()
        result = bench.run(cycles, first, second)
        assert np.all((result.sent_pa >= LOWEST) & (result.sent_pa <= HIGHEST))
        assert {fault.code for fault in result.faults} <= set(FAULT_CODES)
    for port in bench.ports:
        sent = [entry for entry in port.take_log() if entry.startswith(">")]
        values = [float(found[1]) * UNIT_PA[name] for entry in sent if (found := SET[name].fullmatch(entry))]
        assert all(LOWEST <= value <= HIGHEST for value in values)
        # Everything else that was sent is a question.
        others = [entry for entry in sent if not SET[name].fullmatch(entry)]
        assert set(others) <= {"> REQ", "> MON", "> A", "> B"}
        if name == "itv":  # one device a port; up is never faster than the slew over the longest pause
            assert np.max(np.diff([0.0, *values]), initial=0.0) <= SLEW * 0.1 + UNIT_PA[name]


# -- fuzz ------------------------------------------------------------------------------------------

LINES = [
    b"0",
    b"512",
    b"1023",
    b"UNKNOWN COMMAND",
    b"OUT OF RANGE",
    b"?",
    b"A ?",
    b"A +014.70 +015.00",
    b"A +014.70 +015.00 MOV HLD",
    b"A +014.70 +015.00 14 kPaG",
    b"A   10v20.0-R24 Jan  9 2025,15:04:07",
    b"A D02 006 Gauge Press                s decimal     7/2 014 02 kPaG",
    b"A  D03 SetPoint    signed    +000.00  +103.40     kPaG",
]
GAUGE = alicat_codec.FrameLayout(3, 1, 2, 1e3, 2)


def mutated(rng):
    """A line of either dialect with some bytes changed, or noise."""
    if rng.random() < 0.3:
        return rng.bytes(int(rng.integers(0, 40)))
    line = bytearray(LINES[rng.integers(len(LINES))])
    for _ in range(rng.integers(0, 4)):
        place = int(rng.integers(0, len(line) + 1))
        match rng.integers(4):
            case 0:
                line.insert(place, int(rng.integers(256)))
            case 1 if place < len(line):
                del line[place]
            case 2 if place < len(line):
                line[place] ^= 1 << int(rng.integers(8))
            case _:
                line += LINES[rng.integers(len(LINES))]
    return bytes(line)


def test_twenty_thousand_lines_through_the_codecs():
    rng = np.random.default_rng(408)
    good = 0
    for _ in range(20_000):
        line = mutated(rng)
        counts = parse(line)
        assert counts is None or 0 <= counts <= 1023
        frame = alicat_codec.parse_frame(line, "A", GAUGE)
        setpoint = alicat_codec.parse_setpoint(line, "A", GAUGE)
        assert frame is None or abs(frame.pressure_pa) < 1e11
        assert setpoint is None or abs(setpoint) < 1e10
        is_refusal(line)
        alicat_codec.is_refusal(line)
        alicat_codec.parse_version(line)
        good += counts is not None or frame is not None or setpoint is not None
    assert 1000 < good < 19_000


class Script:
    """A port whose other end is a list of answers."""

    name = "script"

    def __init__(self):
        self.coming = b""
        self.sent = 0

    def read(self):
        chunk, self.coming = self.coming, b""
        return chunk

    def write(self, data):
        self.sent += 1

    def fileno(self):
        return -1

    def close(self):
        pass


@pytest.mark.parametrize("name", MAKE)
def test_twenty_thousand_answers_each_bad_one_counted(name):
    rng = np.random.default_rng(17)
    bench = MAKE[name]()
    bench.driver.configure()
    engine = bench.engines[0]
    engine.port = port = Script()
    outcomes = []
    for channel in engine.channels:
        channel.latch = lambda code, message: None  # a device that is given up is asked no more
        answer = channel.answer
        channel.answer = lambda *given, answer=answer: outcomes.append(answer(*given)) or outcomes[-1]
    now_ns, lines = bench.driver.now_ns(), 0
    for _ in range(20_000):
        now_ns += 20_000_000
        channel = engine.channels[rng.integers(len(engine.channels))]
        channel.follow(rng.uniform(0, 90e3), 0.02)
        engine.send(now_ns)
        line = mutated(rng).replace(b"\r", b"").replace(b"\n", b"")
        port.coming = line + b"\r"
        before = engine.counts.copy()
        outcomes.clear()
        engine.receive(now_ns + 1)
        bad = sum((engine.counts - before)[kind] for kind in ("garbled", "refused", "late"))
        if line and len(line) <= 120:
            lines += 1
            assert len(outcomes) == 1, "every line is an answer to the one question"
            assert bad == (outcomes[0] != "good")
        else:
            engine.discard(now_ns)
    assert lines > 18_000
    assert engine.counts["garbled"] > 5_000


def test_any_table_is_a_layout_or_a_value_error():
    rng = np.random.default_rng(7)
    for _ in range(2000):
        rows = [mutated(rng) for _ in range(rng.integers(0, 6))]
        with contextlib.suppress(ValueError):
            assert alicat_codec.parse_layout(rows, "A").columns >= 2


def test_splitter_loses_nothing_and_is_bounded():
    rng = np.random.default_rng(11)
    splitter = LineSplitter(b"\r\n")
    for _ in range(2000):
        chunk = rng.bytes(int(rng.integers(0, 60)))
        for line in splitter.feed(chunk):
            assert 0 < len(line) <= 120
            assert b"\r" not in line
            assert b"\n" not in line


@pytest.mark.parametrize("name", MAKE)
def test_noise_on_the_wire_breaks_nothing_and_is_counted(name):
    """Noise, lost and changed answers: no exception, every fault a known one, and it works again after."""
    rng = np.random.default_rng(2026)
    bench = MAKE[name]()
    bench.driver.configure()
    disturbed = [0]

    def to_host(chunk):
        chance = rng.random()
        if chance < 0.05:
            disturbed[0] += 1
            return mutated(rng) + b"\r\n" + chunk
        if chance < 0.08:
            disturbed[0] += 1
            return b""
        if chance < 0.11:
            disturbed[0] += 1
            changed = bytearray(chunk)
            changed[rng.integers(len(changed))] ^= 1 << int(rng.integers(7))
            return bytes(changed)
        return chunk

    before = bench.driver.statistics
    for line in bench.devices.lines:
        line.to_host = to_host
    for cycle in range(1500):
        setpoint = 45e3 + 30e3 * np.sin(cycle / 40)
        result = bench.exchange(setpoint)
        assert {fault.code for fault in result.faults} <= set(FAULT_CODES)
        assert np.all((result.sent_pa >= LOWEST) & (result.sent_pa <= HIGHEST))
        if bench.driver.latched and cycle % 50 == 0:
            for line in bench.devices.lines:
                line.to_host = lambda chunk: chunk
            bench.driver.configure()
            for line in bench.devices.lines:
                line.to_host = to_host
    after = bench.driver.statistics
    counted = sum(
        getattr(after, count) - getattr(before, count)
        for count in ("frames_garbled", "frames_lost", "frames_late", "frames_refused")
    )
    assert disturbed[0] > 50
    # One disturbance may touch two answers, and several may fall into one flush of the line.
    assert counted >= 0.3 * disturbed[0]
    for line in bench.devices.lines:
        line.to_host = lambda chunk: chunk
    bench.driver.configure()
    result = bench.run(120, 40e3)
    assert result.faults == ()
    np.testing.assert_allclose(bench.devices.pressure_pa, 40e3, atol=400)


@pytest.mark.parametrize("name", MAKE)
def test_noise_to_the_devices_moves_no_valve_out_of_range(name):
    rng = np.random.default_rng(99)
    bench = MAKE[name]()
    for _ in range(3000):
        line = bench.devices.lines[rng.integers(len(bench.devices.lines))]
        chunk = (
            mutated(rng) if rng.random() < 0.7 else b"SET %d\r\nBS%.2f\r" % tuple(rng.integers(-5, 2000, 2))
        )
        line.take(chunk + b"\r\n")
        bench.devices.now_ns += 30_000_000
        bench.devices.work(bench.devices.now_ns)
        demands = [valve.demand_pa() for valve in bench.valves]
        assert all(demand is not None and 0.0 <= demand <= 103.4e3 for demand in demands)
