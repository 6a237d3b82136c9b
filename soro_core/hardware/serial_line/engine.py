"""One request at a time on a serial line, without ever waiting for it.

The driver calls `receive` and `send` whenever it has time; between them the line works on its own. Answers
carry no tag, so that after a lost or malformed one everything is thrown away until the line has been quiet:
what comes then belongs to the next request.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from soro_core.hardware.serial_line.channel import Channel, Request
from soro_core.hardware.serial_line.port import BytePort

BITS_PER_BYTE = 10  # start, 8 data, stop
LONGEST_LINE = 120


class LineSplitter:
    """Bytes into lines; every terminator byte ends one, and empty lines are dropped."""

    def __init__(self, terminators: bytes) -> None:
        self._terminators = terminators
        self._rest = bytearray()
        self.overlong = 0

    def feed(self, chunk: bytes) -> list[bytes]:
        """Complete lines, without their ends."""
        lines = []
        for byte in chunk:
            if byte in self._terminators:
                if self._rest:
                    lines.append(bytes(self._rest))
                self._rest.clear()
            else:
                self._rest.append(byte)
                if len(self._rest) > LONGEST_LINE:
                    self._rest.clear()
                    self.overlong += 1
        return lines

    def clear(self) -> None:
        """Forget what has begun."""
        self._rest.clear()


class LineEngine:
    """Requests of the channels on one port, in turn.

    Parameters
    ----------
    port : BytePort
        The line.
    channels : sequence of Channel
        The devices on it.
    baud : int
        Its rate, for how long requests take.
    answer_timeout_s, quiet_s
        Time for an answer after its request; silence that ends a disturbance.
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
        self._patience_ns = 0  # until when a disturbance may last

    def receive(self, now_ns: int) -> None:
        """Take what has come, and give up what has not."""
        chunk = self.port.read()
        if chunk:
            self._take(chunk, now_ns)
        if self._waiting is not None and now_ns >= self._deadline_ns:
            channel, request = self._waiting
            self._waiting = None
            self.counts["lost"] += 1
            self._disturb(now_ns)
            channel.missed_answer(request, now_ns)

    def send(self, now_ns: int) -> None:
        """Ask the next question if the line is free."""
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
        """Throw away what has come and what is awaited; what was thrown away (start-up only)."""
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
            # Still noise, or an answer that came too late: the silence begins anew. A line that is never
            # quiet is asked all the same, for a vent must get through.
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
        """In turn; those that must vent come first, a silent one is asked in every tenth round only."""
        count = len(self.channels)
        order = [(self._last + 1 + k) % count for k in range(count)]
        urgent = [number for number in order if self.channels[number].urgent]
        heard = [number for number in order if self.channels[number].due_round(self._round)]
        number = (urgent or heard or order)[0]
        self._round += number <= self._last
        self._last = number
        return self.channels[number]
