"""One request at a time on a serial line, without waiting.

The driver calls `receive` and `send` whenever it has time. Answers do not name their request. So after a lost
or malformed answer all bytes are dropped until the line has been quiet; then the next answer belongs to the
next request.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from soro_hardware.serial_line.line.channel import Channel
from soro_hardware.serial_line.line.port import BytePort
from soro_hardware.serial_line.line.request import LineSplitter, Request
from soro_hardware.serial_line.pace import BITS_PER_BYTE

_SILENT_ROUNDS = 10


class LineEngine:
    """Requests of the channels on one port, in turn.

    Parameters
    ----------
    port : BytePort
        Port of the line.
    channels : sequence of Channel
        Devices on the line.
    baud : int
        Baud rate, for the duration of requests.
    answer_timeout_s, quiet_s : float
        Longest wait for an answer after its request, and pause that ends a disturbance [s].
    """

    def __init__(
        self,
        port: BytePort,
        channels: Sequence[Channel],
        baud: int,
        answer_timeout_s: float,
        quiet_s: float,
    ) -> None:
        self.port, self.channels = port, tuple(channels)
        self.counts: Counter[str] = Counter()
        self._byte_ns = BITS_PER_BYTE * 1e9 / baud
        self._timeout_ns, self._quiet_ns = round(1e9 * answer_timeout_s), round(1e9 * quiet_s)
        self._splitter = LineSplitter(b"\r\n")
        self._last, self._round = -1, 0
        self._waiting: tuple[Channel, Request] | None = None
        self._deadline_ns = 0
        self._ready_ns = 0  # earliest time of the next request
        self._disturbed = False
        self._reopen_ns = 0
        self._patience_ns = 0  # end of the longest disturbance

    def advance(self, now_ns: int) -> None:
        """Process received bytes, and send the next request if the line is free."""
        self.receive(now_ns)
        self.send(now_ns)

    def reopen(self, now_ns: int, pause_ns: int) -> bool:
        """Try to open a lost port, with pauses; its devices then get zeros until the start-up."""
        if now_ns < self._reopen_ns:
            return False
        self._reopen_ns = now_ns + pause_ns
        if not self.port.reopen():
            return False
        self._waiting, self._disturbed = None, False
        self._splitter.clear()
        for channel in self.channels:
            channel.reconnected()
        return True

    def receive(self, now_ns: int) -> None:
        """Process received bytes, and count a missing answer after its timeout."""
        chunk = self.port.read()
        if chunk:
            self._take(chunk, now_ns)
        if self._waiting is not None and now_ns >= self._deadline_ns:
            channel, _ = self._waiting
            self._waiting = None
            self.counts["lost"] += 1
            self._disturb(now_ns)
            channel.missed_answer()

    def send(self, now_ns: int) -> None:
        """Send the next request if the line is free."""
        if self._waiting is not None or now_ns < self._ready_ns:
            return
        if self._disturbed:
            self._disturbed = False
            self._splitter.clear()
        channel = self._next_channel()
        request = channel.next_request(now_ns)
        self._waiting = (channel, request)
        self._deadline_ns = now_ns + round(len(request.data) * self._byte_ns) + self._timeout_ns
        self.counts["sent"] += 1
        self.port.write(request.data)

    def discard(self, now_ns: int) -> bytes:
        """Drop received bytes and the open request; return the bytes (start-up only)."""
        chunk = self.port.read()
        self._waiting, self._disturbed = None, False
        self._splitter.clear()
        self._ready_ns = now_ns
        return chunk

    def _take(self, chunk: bytes, now_ns: int) -> None:
        before = self._splitter.overlong
        lines = self._splitter.feed(chunk)
        self.counts["garbled"] += self._splitter.overlong - before
        if self._disturbed:
            # Noise or a late answer: the pause starts again. After the longest disturbance a request is sent
            # also on a line that is never quiet, because a vent must reach the device.
            self.counts["late"] += len(lines)
            self._ready_ns = min(now_ns + self._quiet_ns, self._patience_ns)
            return
        for line in lines:
            if self._waiting is None:
                self.counts["late"] += 1
                self._disturb(now_ns)
                continue
            channel, request = self._waiting
            self._waiting = None
            self.counts["received"] += 1
            outcome = channel.answer(request, line, now_ns)
            if outcome == "refused":
                self.counts["refused"] += 1
            elif outcome != "good":
                self.counts["garbled"] += 1
                self._disturb(now_ns)

    def _disturb(self, now_ns: int) -> None:
        self._disturbed = True
        self._ready_ns = now_ns + self._quiet_ns
        self._patience_ns = now_ns + self._timeout_ns

    def _next_channel(self) -> Channel:
        """Return the next channel in turn: urgent ones first, silent ones only in every tenth round."""
        count = len(self.channels)
        order = [(self._last + 1 + k) % count for k in range(count)]
        turns = {number: self.channels[number].urgency for number in order}
        if urgent := {number: had for number, had in turns.items() if had is not None}:
            return self.channels[min(urgent, key=urgent.__getitem__)]
        is_for_all = self._round % _SILENT_ROUNDS == 0
        answering = [number for number in order if is_for_all or not self.channels[number].is_silent]
        number = (answering or order)[0]
        self._round += number <= self._last
        self._last = number
        return self.channels[number]
