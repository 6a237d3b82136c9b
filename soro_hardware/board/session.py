"""Frames that the driver sends and receives; the driver judges their content."""

from __future__ import annotations

from dataclasses import replace

from soro_core.errors import HardwareError
from soro_hardware.board import frames, messages
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.board.messages import Refusal, StateMessage, Welcome
from soro_hardware.transport.tcp import ByteLink, drain


class BoardSession:
    """Frames of one driver; every failure of the connection is a `HardwareError` of the link.

    Parameters
    ----------
    link : ByteLink
        Connection to the board.
    ports : int
        Number of ports of the board.

    Attributes
    ----------
    welcome, state, refusal : Welcome, StateMessage, tuple of int
        Newest frames of the board, None before the first; `refusal` is reason and port.
    sequence, answered : int
        Sequence numbers of the newest SET or RESET, and of the newest STATE.
    """

    def __init__(self, link: ByteLink, ports: int) -> None:
        self.link, self._ports = link, ports
        self._decoder = frames.BoardFrameDecoder(messages.lengths(ports))
        self.welcome: Welcome | None = None
        self.state: StateMessage | None = None
        self.refusal: tuple[int, int] | None = None
        self.sequence = self.answered = self._number = 0
        self.sent = self.received = self.late = self.refused = self._unknown = 0

    @property
    def garbled(self) -> int:
        """Number of invalid frames, and of frames that this version does not know."""
        return self._decoder.garbled + self._unknown

    @property
    def is_answered(self) -> bool:
        """Whether the newest SET or RESET has been answered."""
        return self.answered == self.sequence

    @property
    def lag(self) -> int:
        """Number of SETs after the one that the newest STATE answers."""
        return (self.sequence - self.answered) & 0xFFFFFFFF

    def greet(self) -> None:
        """Start with a new connection: send HELLO."""
        self._decoder.reset()
        self.welcome = self.state = self.refusal = None
        self.answered, self._number = -1, 0
        self._send(BoardFrame(FrameType.HELLO, 0, messages.pack_hello(self._ports)))

    def reset(self) -> None:
        """Send RESET, and restart the sequence."""
        self.sequence, self.answered = 1, -1
        self._send(BoardFrame(FrameType.RESET, self.sequence))

    def set(self, values: list[int]) -> None:
        """Send SET with one set point for every port [Pa gauge]; nothing before the board's WELCOME."""
        if self.welcome is None:
            return
        self.sequence = (self.sequence + 1) & 0xFFFFFFFF
        self._send(BoardFrame(FrameType.SET, self.sequence, messages.pack_set(values)))

    def bye(self) -> None:
        """Send BYE."""
        self._send(BoardFrame(FrameType.BYE, self.sequence))

    def receive(self, timeout_s: float) -> bool:
        """Receive frames, waiting at most `timeout_s` [s]; return whether any bytes arrived."""
        chunk = self.link.receive(timeout_s)
        for frame in self._decoder.feed(chunk):
            self.received += 1
            if frame.kind is FrameType.STATE:
                self._on_state(frame)
            elif frame.kind is FrameType.WELCOME:
                self.welcome, self._number = messages.unpack_welcome(frame.payload), frame.number
            elif frame.kind is FrameType.REFUSED:
                self.refused += 1
                refusal = messages.unpack_refused(frame.payload)
                if refusal[0] != Refusal.OLD:  # a duplicated or late frame does no harm
                    self.refusal = refusal
        return bool(chunk)

    def drain(self) -> None:
        """Receive without waiting; close a connection that sends without a pause."""
        if not drain(self.receive):
            self.link.close()
            raise HardwareError("the board sends without a pause", code="flood")

    def _send(self, frame: BoardFrame) -> None:
        self.link.send(frames.encode(replace(frame, number=self._number)))
        self.sent += 1

    def _on_state(self, frame: BoardFrame) -> None:
        try:
            self.state = messages.unpack_state(frame.payload)
        except ValueError:
            self._unknown += 1
            return
        # The heartbeat repeats the last sequence number; another one is the answer to an earlier SET.
        self.late += frame.sequence not in (self.sequence, self.answered)
        self.answered = frame.sequence
