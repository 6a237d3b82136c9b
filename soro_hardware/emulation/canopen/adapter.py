"""Emulated CAN adapters, and their protocols with the host: slcan and socketcand."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

from soro_hardware.emulation.canopen.hub import ErrorCounters
from soro_hardware.emulation.line import Line
from soro_hardware.transport import frame
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.slcan_codec import BEL, CR, LONGEST_LINE, decode_frame, encode
from soro_hardware.transport.socketcand import SocketcandDecoder, Word, encode_error, encode_frame

LONGEST_OUTPUT = 65536  # bytes kept for a host that does not read; further messages are lost


class Adapter(Line):
    """One adapter on the bus.

    Parameters
    ----------
    send : callable
        Sends a frame of the host to the bus; returns False if the bus refuses it.

    Attributes
    ----------
    rejoin : callable
        Resets the controller, as a host does when it closes and opens an adapter in bus-off.
    overruns : int
        Number of messages lost because the host does not read.
    """

    def __init__(self, send: Callable[[Frame], bool]) -> None:
        super().__init__()
        self.send = send
        self.rejoin: Callable[[], None] = lambda: None
        self.overruns = 0

    @abstractmethod
    def deliver(self, frame: Frame, now_ns: int) -> None:
        """Receive a frame from the bus."""

    @abstractmethod
    def report(self, errors: ErrorCounters, letter: str) -> None:
        """Report the state of the controller, or an error on the bus, to the host; as `Controller.report`."""

    def say(self, text: bytes) -> None:
        """Send a message to the host; count an overrun if the output is full."""
        if len(self.output) > LONGEST_OUTPUT:
            self.overruns += 1
        else:
            self.put(text)


_STATES = {"active": b"a", "warning": b"w", "passive": b"p", "bus_off": b"b"}
_STOCK_VERSION = b"b158aa7 https://github.com/normaldotcom/canable-fw.git\r"
_STAMPS = 60_000  # a time stamp is in ms within its minute
_FLAGS = {"active": 0x00, "warning": 0x04, "passive": 0x24, "bus_off": 0xA4}


class SlcanServer(Adapter):
    """An emulated slcan adapter; parameters as in `Adapter`."""

    def __init__(self, send: Callable[[Frame], bool]) -> None:
        super().__init__(send)
        self._open = self._listen_only = False
        self._flags = 0
        self._rest = b""

    def take(self, chunk: bytes) -> None:
        *lines, self._rest = (self._rest + chunk).split(CR)
        if len(self._rest) > LONGEST_LINE:
            self._rest = b"?"  # noise: refused as one command at its CR
        for line in lines:
            if answer := self.obey(line):
                self.say(answer)

    def deliver(self, frame: Frame, now_ns: int) -> None:
        if self._open:
            self.say(encode(frame))

    def report(self, errors: ErrorCounters, letter: str) -> None:
        self._flags = _FLAGS[errors.state]
        if not self._open:
            return
        if letter:
            self.say(b"e1%s\r" % letter.encode())
        counters = b"%03d%03d" % (min(errors.receive, 255), min(errors.transmit, 255))
        self.say(b"s%s%s\r" % (_STATES[errors.state], counters))

    def obey(self, line: bytes) -> bytes:
        """Execute a line and return its answer; the empty line that python-can sends first has none."""
        return self._command(line) if line else b""

    def _command(self, line: bytes) -> bytes:
        kind = line[:1]
        if kind in b"tTrR":
            frame = decode_frame(line)
            if frame is None or not self._open or self._listen_only or not self.send(frame):
                return BEL
            return b"z\r" if kind in b"tr" else b"Z\r"
        if line == b"C":
            self._open = False
            self.output.clear()  # a new host does not receive messages for the last one
            return CR
        if line in (b"O", b"L"):
            if not self._open:  # python-can sends O twice
                self.rejoin()
            self._open, self._listen_only = True, line == b"L"
            return CR
        if len(line) == 2 and kind == b"S" and line[1:] in b"0123456789"[:9]:
            return BEL if self._open else CR
        flags = b"F%02X\r" % self._flags if self._open else BEL
        return {b"V": b"V1013\r", b"N": b"NA408\r", b"F": flags}.get(line, BEL)


class RememberingSlcanServer(SlcanServer):
    """A LAWICEL adapter whose last owner left time stamps on and the delivery of frames off.

    It keeps both without power; Z and X change them while the bus is closed (CAN232 manual).
    """

    def __init__(self, send: Callable[[Frame], bool]) -> None:
        super().__init__(send)
        self._settings = {b"Z": True, b"X": False}

    def deliver(self, frame: Frame, now_ns: int) -> None:
        if not (self._open and self._settings[b"X"]):
            return
        line = encode(frame)
        if self._settings[b"Z"]:
            line = b"%s%04X\r" % (line[:-1], now_ns // 1_000_000 % _STAMPS)
        self.say(line)

    def _command(self, line: bytes) -> bytes:
        kind, value = line[:1], line[1:]
        if kind not in self._settings:
            return super()._command(line)
        if self._open or value not in (b"0", b"1"):
            return BEL
        self._settings[kind] = value == b"1"
        return CR


class SilentSlcanServer(SlcanServer):
    """An adapter with the stock firmware of the CANable: it answers only V, and reports no errors.

    An empty line repeats the last command (canable-fw, canable2-fw: slcan.c, usbd_cdc_if.c).
    """

    def __init__(self, send: Callable[[Frame], bool]) -> None:
        super().__init__(send)
        self._last = b""

    def obey(self, line: bytes) -> bytes:
        self._last = line or self._last
        super().obey(self._last)
        return _STOCK_VERSION if self._last[:1] == b"V" else b""

    def report(self, errors: ErrorCounters, letter: str) -> None:
        pass


_CLASSES = {"a": frame.NO_ACKNOWLEDGE, "o": frame.CONTROLLER}


class SocketcandServer(Adapter):
    """An emulated socketcand server: greeting, open bus, raw mode; parameters as in `Adapter`."""

    transport = "tcp"

    def __init__(self, send: Callable[[Frame], bool]) -> None:
        super().__init__(send)
        self._decoder = SocketcandDecoder()
        self._open = self._raw = False
        self._now_ns = 0

    def connected(self, has_host: bool) -> None:
        self._decoder, self._open, self._raw = SocketcandDecoder(), False, False
        if has_host:
            self.say(b"< hi >")

    def take(self, chunk: bytes) -> None:
        for message in self._decoder.feed(chunk):
            if isinstance(message, Frame):
                if self._raw:
                    self.send(message)
            elif isinstance(message, Word):
                self.say(self._command(message.text))

    def deliver(self, frame: Frame, now_ns: int) -> None:
        self._now_ns = now_ns
        if self._raw and not frame.remote:
            self.say(encode_frame(frame, now_ns))

    def report(self, errors: ErrorCounters, letter: str) -> None:
        if not self._raw:
            return
        classes = _CLASSES.get(letter, frame.PROTOCOL) if letter else frame.CONTROLLER
        if errors.is_off:
            classes = frame.BUS_OFF
        self.say(encode_error(classes, self._now_ns))

    def _command(self, text: str) -> bytes:
        if text == "echo":
            return b"< echo >"
        if text.startswith("open ") and not self._open:
            self._open = True
            self.rejoin()
            return b"< ok >"
        if text == "rawmode" and self._open:
            self._raw = True
            return b"< ok >"
        return b"< error unknown command >"
