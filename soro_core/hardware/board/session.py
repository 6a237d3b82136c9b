"""The driver's side of the frames: what was sent, what has been heard, what it means is the driver's."""

from __future__ import annotations

from collections.abc import Callable

from soro_core.errors import HardwareError
from soro_core.hardware.board import frames, messages
from soro_core.hardware.board.frames import Frame, Kind
from soro_core.hardware.board.messages import Refusal, State, Welcome
from soro_core.hardware.transport.tcp import ByteLink, drain


class Session:
    """Frames of one driver; every failure of the connection is a `HardwareError` of the link.

    Parameters
    ----------
    link : ByteLink
        Connection to the board.
    ports : int
        Ports that the board must have.

    Attributes
    ----------
    welcome, state, refused
        Newest frames of the board, None before the first; `refused` as (reason, port).
    sequence, answered : int
        Sequence numbers of the newest SET or RESET, and of the newest STATE.
    """

    def __init__(self, link: ByteLink, ports: int) -> None:
        self.link, self._ports = link, ports
        self._decoder = frames.Decoder(messages.lengths(ports))
        self.welcome: Welcome | None = None
        self.state: State | None = None
        self.refused: tuple[int, int] | None = None
        self.sequence = self.answered = 0
        self.sent = self.received = self.late = self.not_obeyed = self._unknown = 0
        self.on_state: Callable[[State], None] = lambda state: None

    @property
    def garbled(self) -> int:
        """Frames that were none, or that this version does not know."""
        return self._decoder.garbled + self._unknown

    @property
    def is_answered(self) -> bool:
        """Whether the newest SET or RESET has its answer."""
        return self.answered == self.sequence

    @property
    def lag(self) -> int:
        """How many SETs have been sent since the one that the newest STATE answers."""
        return (self.sequence - self.answered) & 0xFFFFFFFF

    def greet(self) -> None:
        """Begin with a new connection: HELLO."""
        self._decoder.reset()
        self.welcome = self.state = self.refused = None
        self.answered = -1
        self._send(Frame(Kind.HELLO, 0, messages.pack_hello(self._ports)))

    def reset(self) -> None:
        """RESET; the sequence begins anew with it."""
        self.sequence, self.answered = 1, -1
        self._send(Frame(Kind.RESET, self.sequence))

    def set(self, values: list[int]) -> None:
        """SET for every port [Pa gauge]."""
        self.sequence = (self.sequence + 1) & 0xFFFFFFFF
        self._send(Frame(Kind.SET, self.sequence, messages.pack_set(values)))

    def bye(self) -> None:
        """BYE."""
        self._send(Frame(Kind.BYE, self.sequence))

    def receive(self, timeout_s: float) -> bool:
        """Take what has come, waiting for it at most so long; whether anything came."""
        chunk = self.link.receive(timeout_s)
        for frame in self._decoder.feed(chunk):
            self.received += 1
            if frame.kind is Kind.STATE:
                self._on_state(frame)
            elif frame.kind is Kind.WELCOME:
                self.welcome = messages.unpack_welcome(frame.payload)
            elif frame.kind is Kind.REFUSED:
                self.not_obeyed += 1
                refused = messages.unpack_refused(frame.payload)
                if refused[0] != Refusal.OLD:  # a frame that came twice or late has done no harm
                    self.refused = refused
        return bool(chunk)

    def drain(self) -> None:
        """Take what has come, without waiting; without an end to it the connection is given up."""
        if not drain(self.receive):
            self.link.close()
            raise HardwareError("the board sends without a pause")

    def _send(self, frame: Frame) -> None:
        self.link.send(frames.encode(frame))
        self.sent += 1

    def _on_state(self, frame: Frame) -> None:
        try:
            self.state = messages.unpack_state(frame.payload)
        except ValueError:
            self._unknown += 1
            return
        # The heartbeat repeats the last sequence number; another one is the answer to an earlier SET.
        self.late += frame.sequence not in (self.sequence, self.answered)
        self.answered = frame.sequence
        self.on_state(self.state)
