"""Whatever is commanded, what reaches the wire of any family is in range and, except in a vent, within slew.

From the limiter through the driver to the bytes: the bytes that the host sends are read here by what is
written down of each protocol, not by the driver's own code.
"""

import re
import struct
import zlib

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.apparatus.faults.matrix import MATRIX
from tests.apparatus.faults.rigs import Loop, rig_of
from tests.apparatus.faults.rows import Row

LOWEST, HIGHEST = 0.0, 90e3
# Rounding of a set point on its way, up or down: a count of the device [Pa].
COUNT_PA = {
    "canopen_408": 10.0,
    "canopen_408, 4 channels": 10.0,
    "itv_rs232": 100e3 / 1023,
    "alicat": 10.0,
    "veab_tcp": 1e-6,
    "soro_board": 1.0,
    "vtem_modbus": 100.0,
}
SERIAL_SLEW = 400e3  # of a driver whose messages are fewer than the set points


class Wire:
    """Set points on the wire: time [s], chamber and pressure [Pa gauge] of each."""

    def __init__(self, family, loop):
        self.family, self.loop = family, loop
        self.seen = [(self._now_s(), chamber, 0.0, False) for chamber in range(3)]
        self._rest = {}
        rig = loop.rig
        if family.startswith("canopen"):
            inner = rig.devices.send
            rig.devices.send = lambda bus, frame: (self._can(frame), inner(bus, frame))[1]
            return
        for number, line in enumerate(rig.devices.lines):
            inner = line.feed
            line.feed = lambda chunk, n=number, inner=inner: (self._bytes(n, chunk), inner(chunk))[1]

    def _note(self, chamber, pressure_pa):
        self.seen.append((self._now_s(), chamber, pressure_pa, self.loop.vented))

    def _now_s(self):
        # On serial lines it is the line's time that counts, and it goes on between the exchanges.
        is_serial = self.family in ("itv_rs232", "alicat")
        return 1e-9 * (self.loop.rig.regulator.now_ns() if is_serial else self.loop.now_ns)

    def _can(self, frame):
        """Control word and set point, 10 Pa a count; four set points in a row on nodes of four valves."""
        if self.family == "canopen_408" and 0x201 <= frame.can_id <= 0x203:
            control, counts = struct.unpack("<Hh", frame.data)
            self._note(frame.can_id - 0x201, counts * 10.0)
            assert control in (0, 1, 3, 7, 8, 15)

    def _bytes(self, line, chunk):
        if self.family in ("itv_rs232", "alicat"):
            chunk = chunk.translate(None, b"\x05\x16")  # ends a cycle in lockstep
        data = self._rest.get(line, b"") + chunk
        read = getattr(self, f"_{self.family}")
        self._rest[line] = read(line, data)

    def _itv_rs232(self, line, data):
        *lines, rest = data.split(b"\r\n")
        for text in filter(None, lines):
            if found := re.fullmatch(rb"SET (\d{1,4})", text):
                self._note(line, int(found[1]) * 100e3 / 1023)
            else:
                assert text in (b"REQ", b"MON")
        return rest

    def _alicat(self, line, data):
        *lines, rest = data.split(b"\r")
        for text in filter(None, lines):
            if found := re.fullmatch(rb"([ABC])LS ([+-]?\d+\.\d\d)", text):
                self._note(b"ABC".index(found[1]), float(found[2]) * 1e3)
            else:
                assert re.fullmatch(rb"[ABC](VE|\?\?D\*|LSS|C)?", text)
        return rest

    def _veab_tcp(self, line, data):
        while len(data) >= 96:
            values, data = struct.unpack("<12d", data[:96]), data[96:]
            assert all(0.0 <= value <= 1.0 for value in values)
            assert values[3:] == (0.5,) * 9
            for chamber, value in enumerate(values[:3]):
                self._note(chamber, value * 200e3 - 100e3)
        return data

    def _soro_board(self, line, data):
        while len(data) >= 18:
            magic, version, kind, length, _, number = struct.unpack_from("<2sBBHIQ", data)
            assert (magic, version) == (b"sB", 2)
            assert (number == 0) == (kind == 1)  # only the greeting does not know the board's number yet
            body, crc = data[: 18 + length], data[18 + length : 22 + length]
            assert zlib.crc32(body) == struct.unpack("<I", crc)[0]
            if kind == 2:
                values = struct.unpack(f"<{length // 4}i", body[18:])
                assert not any(values[3:])
                for chamber, value in enumerate(values[:3]):
                    self._note(chamber, float(value))
            data = data[22 + length :]
        return data

    def _vtem_modbus(self, line, data):
        """Slot 0 regulates both valves, slot 1 its first; single registers at the start and the end."""
        while len(data) >= 12:
            _, protocol, length, unit, function, address, value = struct.unpack_from(">HHHBBHH", data)
            assert (protocol, unit) == (0, 255)
            body, data = data[12 : 6 + length], data[6 + length :]
            if function == 16:
                assert (address, value, body[0]) == (40003, 6, 12)
                first, second = struct.unpack(">Hhh", body[1:7]), struct.unpack(">Hhh", body[7:])
                assert (first[0], second[0], second[2]) == (3 << 6 | 3, 2 << 6 | 3, 0)
                for chamber, mbar in enumerate((*first[1:], second[1])):
                    self._note(chamber, mbar * 100.0)
            elif function == 6:
                assert 40003 <= address < 40009
                assert value == (0 if (address - 40003) % 3 else 61)
            else:
                assert (function, address, value) == (3, 45395, 6)
        return data


anything = st.floats(allow_nan=True, allow_infinity=True, width=64)
pressure = st.one_of(st.floats(LOWEST, HIGHEST), st.sampled_from([0.0, -0.0, HIGHEST, HIGHEST + 1e-3]))
event = st.tuples(
    st.lists(st.one_of(pressure, pressure, anything), min_size=3, max_size=3),
    st.integers(-200, 200),  # age of its stamp [ms]; most are of now
    st.sampled_from([True, True, True, False]),
    st.integers(1, 8),  # cycles with it
    st.sampled_from([0, 0, 0, 0, 3, 30]),  # cycles that the host is held up for
    st.sampled_from(["", "", "", "", "vent", "reset"]),
)


def play(family, events):
    """Run a sequence of commands; what has been seen on the wire."""
    loop = Loop(rig_of(family, Row("", "tolerate")))
    loop.rig.regulator.configure()
    wire = Wire(family, loop)
    for command, age_ms, is_fresh, cycles, stall, action in events:
        loop.cycles += stall
        if action == "vent":
            loop.limited.vent("asked for")
        if action == "reset" and loop.vented:
            loop.limited.offer(np.zeros(3), loop.now_ns, loop.now_ns)
            loop.reset()
        for _ in range(cycles):
            now = loop.now_ns
            stamp = now - (0 if is_fresh else age_ms * 1_000_000)
            loop.limited.offer(np.array(command), stamp, now)
            loop.cycle(None)
    seen = list(wire.seen)
    loop.rig.close()  # brings the pressures down by itself
    return loop, seen


def judge(family, loop, seen):
    """In range; and from message to message of a chamber within slew, unless it vents."""
    count, is_serial = COUNT_PA[family], family in ("itv_rs232", "alicat")
    rise = SERIAL_SLEW if is_serial else loop.limited.limits.rise_pa_s
    fall = SERIAL_SLEW if is_serial else loop.limited.limits.fall_pa_s
    last = {}
    for t, chamber, pressure_pa, vented in seen:
        assert LOWEST - 1e-6 <= pressure_pa <= HIGHEST + 1e-6
        before_s, before_pa, before_that_s = last.get(chamber, (t, 0.0, t))
        last[chamber] = t, pressure_pa, before_that_s if t == before_s else before_s
        if vented:
            assert pressure_pa == pytest.approx(0.0, abs=1e-6)
            continue
        # What goes out now was computed in the cycle before, from the time since the one before that: after a
        # host that was held up it is what 0.1 s of that time allow.
        dt = max(t - before_s, min(before_s - before_that_s, loop.limited.limits.command_age_s))
        assert pressure_pa - before_pa <= rise * dt + count
        assert before_pa - pressure_pa <= fall * dt + count


@pytest.mark.slow
@pytest.mark.parametrize("family", [family for family in MATRIX if family in COUNT_PA and "," not in family])
@settings(max_examples=25, deadline=None, derandomize=True)
@given(events=st.lists(event, min_size=1, max_size=14))
# A host that is held up vents before the exchange, whose slew would send a last set point above 0.
@example(events=[([0.0, 0.0, 2006.0], 0, True, 8, 0, ""), ([0.0, 0.0, 90000.001], 0, True, 1, 30, "")])
def test_in_range_and_within_slew(family, events):
    loop, seen = play(family, events)
    judge(family, loop, seen)


@pytest.mark.parametrize("family", [family for family in MATRIX if "," not in family])
def test_pressure_gets_there_and_a_vent_takes_it_away(family):
    """So that the property does not hold of a driver that sends nothing."""
    up = ([80e3, 40e3, 20e3], 0, True, 120, 0, "")
    loop, seen = play(family, [up, ([80e3, 40e3, 20e3], 0, True, 30, 0, "vent")])
    judge(family, loop, seen)
    for chamber, wanted in enumerate((80e3, 40e3, 20e3)):
        mine = [pa for _, n, pa, _ in seen if n == chamber]
        assert max(mine) == pytest.approx(wanted, abs=COUNT_PA[family])
        assert mine[-1] == pytest.approx(0.0, abs=1e-6)


def test_a_jump_is_seen():
    loop, seen = play("veab_tcp", [([80e3, 40e3, 20e3], 0, True, 50, 0, "")])
    t, chamber, pressure_pa, _ = seen[60]
    with pytest.raises(AssertionError):
        judge("veab_tcp", loop, [*seen[:60], (t, chamber, pressure_pa + 2e3, False), *seen[61:]])
    with pytest.raises(AssertionError):
        judge("veab_tcp", loop, [*seen, (t + 1.0, 0, 1e3, True)])
