"""LAWICEL ASCII (slcan) as pure functions: frames, replies and bus health; no input raises an error.

A line ends with CR; four digits behind a frame are its time stamp, which is dropped. An adapter refuses a
command with a lone BEL. Health lines are those of the Linux driver (drivers/net/can/slcan/slcan-core.c):
``s[abpw]RRRTTT`` state and error counters, ``eN<codes>`` bus errors.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TypeAlias

from soro_hardware.transport.frame import Frame

CR, BEL = b"\r", b"\x07"
# LAWICEL speed codes. S7 (800k) is not used: libraries disagree on its rate.
SPEEDS = {10_000: 0, 20_000: 1, 50_000: 2, 100_000: 3, 125_000: 4, 250_000: 5, 500_000: 6, 1_000_000: 8}

# The longest good line is an extended frame with eight bytes, 26 characters; beyond this it is noise.
LONGEST_LINE = 64

_STANDARD = re.compile(rb"([tr])([0-7][0-9A-Fa-f]{2})([0-8])((?:[0-9A-Fa-f]{2})*)")
_EXTENDED = re.compile(rb"([TR])([01][0-9A-Fa-f]{7})([0-8])((?:[0-9A-Fa-f]{2})*)")
_STAMP = re.compile(rb"[0-9A-Fa-f]{4}")
_LINE = re.compile(rb"([^\r\x07]*)([\r\x07])")
_HEALTH = re.compile(rb"s([abpw])([0-9]{3})([0-9]{3})")
_ERRORS = re.compile(rb"e([1-9])([abBcfoOs]*)")
_STATES = {b"a": "active", b"w": "warning", b"p": "passive", b"b": "bus_off"}


@dataclass(frozen=True)
class Health:
    """State of the adapter's CAN controller and its error counters (decimal, 0 to 255)."""

    state: str
    rx_errors: int
    tx_errors: int


@dataclass(frozen=True)
class BusErrors:
    """Errors on the bus: a = no acknowledge, b B = bit, c = CRC, f = form, o O = overrun, s = stuff."""

    codes: str


@dataclass(frozen=True)
class Reply:
    """A line that is neither frame nor health: ``''`` and ``z``/``Z`` are "done", BEL is "refused"."""

    text: str

    @property
    def ok(self) -> bool:
        """Whether the adapter has executed the command."""
        return self.text != "\x07"


_DONE = {line: Reply(line.decode()) for line in (b"", b"z", b"Z")}

Event: TypeAlias = Frame | Health | BusErrors | Reply


def encode(frame: Frame) -> bytes:
    """Return a frame as a line with its CR."""
    kind = ("R" if frame.extended else "r") if frame.remote else ("T" if frame.extended else "t")
    identifier = f"{frame.can_id:08X}" if frame.extended else f"{frame.can_id:03X}"
    return f"{kind}{identifier}{frame.dlc}{'' if frame.remote else frame.data.hex().upper()}\r".encode()


def decode_frame(line: bytes) -> Frame | None:
    """Return the frame in a line without CR, or None if the line is malformed."""
    match = _STANDARD.fullmatch(line) or _EXTENDED.fullmatch(line)
    if match is None:
        return None
    kind, identifier, dlc, data = match.groups()
    remote, length = kind in b"rR", dlc[0] - 48
    if len(data) != (0 if remote else 2 * length):
        return None
    return Frame(
        int(identifier, 16), bytes.fromhex(data.decode()), kind in b"TR", remote, length if remote else -1
    )


@dataclass
class SlcanDecoder:
    """Splits the byte stream of an adapter into events; malformed lines are counted and dropped."""

    garbled: int = 0
    _rest: bytes = b""
    _skipping: bool = field(default=False, repr=False)

    def feed(self, chunk: bytes) -> list[Event]:
        """Return the events completed by `chunk`, in order."""
        data = self._rest + chunk
        # Not beyond the last end of a line: the search would begin again at every byte of noise behind it.
        end = max(data.rfind(CR), data.rfind(BEL)) + 1
        events: list[Event] = []
        for match in _LINE.finditer(data, 0, end):
            line, stop = match.groups()
            if self._skipping:  # the end of an overlong line, counted when it was found
                self._skipping = False
            elif line or stop == CR:
                event = _decode(line) if stop == CR else None  # a line cut off by BEL is malformed
                if event is None:
                    self.garbled += 1
                else:
                    events.append(event)
            if stop == BEL:
                events.append(Reply("\x07"))
        self._rest = data[end:]
        if len(self._rest) > LONGEST_LINE:
            self.garbled += not self._skipping
            self._rest, self._skipping = b"", True
        return events

    def reset(self) -> None:
        """Drop an incomplete line."""
        self._rest, self._skipping = b"", False


def _decode(line: bytes) -> Event | None:
    if line in _DONE:  # as many as frames, so before them
        return _DONE[line]
    frame = decode_frame(line)
    if frame is None and _STAMP.fullmatch(line[-4:]):
        frame = decode_frame(line[:-4])
    if frame is not None:
        return frame
    if match := _HEALTH.fullmatch(line):
        return Health(_STATES[match[1]], int(match[2]), int(match[3]))
    if (match := _ERRORS.fullmatch(line)) and len(match[2]) == int(match[1]):
        return BusErrors(match[2].decode())
    if re.fullmatch(rb"[VNF][0-9A-Za-z]{2,8}", line):
        return Reply(line.decode())
    return None
