"""An emulated adapter with a socketcand server: text over TCP, one host at a time."""

from __future__ import annotations

from collections.abc import Callable

from soro_hardware.emulation.canopen.adapter import Adapter
from soro_hardware.emulation.canopen.error_counters import ErrorCounters
from soro_hardware.transport import error_frames
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.socketcand_codec import SocketcandDecoder, Word, encode_error, encode_frame

_CLASSES = {"a": error_frames.NO_ACKNOWLEDGE, "o": error_frames.CONTROLLER}


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
        classes = _CLASSES.get(letter, error_frames.PROTOCOL) if letter else error_frames.CONTROLLER
        if errors.is_off:
            classes = error_frames.BUS_OFF
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
