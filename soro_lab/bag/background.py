"""Writing a bag in a separate thread, so that compression and disk never delay the receiver of messages."""

from __future__ import annotations

import threading
import time
from collections import deque

from soro_core.errors import BagError, SoroError
from soro_lab.bag.topics import Topic
from soro_lab.bag.writer import BagWriter

# Time between two rounds of the thread [s]: few thread switches, little loss in a crash.
_GATHER_S = 0.05


class BackgroundWriter:
    """Accepts messages without waiting, and writes them in the same order.

    Parameters
    ----------
    writer : BagWriter
        The open bag; the caller must not use it until `close`.
    flush_s : float
        Longest time from a message to its place in a file of the operating system, which keeps it when the
        process is killed; a disk that is slower takes longer [s].
    buffer_bytes : int
        Messages are dropped and counted while more than this waits for the disk.

    Attributes
    ----------
    dropped : int
        Number of messages that are not in the bag.
    failure : BagError or None
        Error that ended writing; None while it works.
    """

    def __init__(self, writer: BagWriter, flush_s: float = 0.5, buffer_bytes: int = 1 << 28) -> None:
        self._writer = writer
        self._buffer_bytes = buffer_bytes
        # Less the round in which a message waits, and the one that writes it.
        self._flush_s = max(0.0, flush_s - 2 * _GATHER_S)
        self._waiting: deque[Topic | tuple[str, bytes, int] | None] = deque()
        self._stop = threading.Event()
        self._taken_bytes = self._done_bytes = 0
        self.dropped = 0
        self.failure: SoroError | None = None
        self._thread = threading.Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    @property
    def waiting_bytes(self) -> int:
        """Bytes accepted but not yet written."""
        return self._taken_bytes - self._done_bytes

    @property
    def message_count(self) -> int:
        """Messages written."""
        return self._writer.message_count

    @property
    def byte_count(self) -> int:
        """Bytes of messages written, before compression."""
        return self._writer.byte_count

    def add_topic(self, topic: Topic) -> None:
        """Register a topic before its first message."""
        self._waiting.append(topic)

    def split(self) -> None:
        """Begin a new file of the bag after the messages accepted so far."""
        self._waiting.append(None)

    def write(self, topic: str, data: bytes, log_time_ns: int) -> None:
        """Accept one message, or drop it if the disk is too slow or has failed.

        Parameters
        ----------
        topic : str
            Name of the topic.
        data : bytes
            Serialised message.
        log_time_ns : int
            Time of reception [ns].
        """
        if (
            self._stop.is_set()
            or self.failure is not None
            or self.waiting_bytes + len(data) > self._buffer_bytes
        ):
            self.dropped += 1
            return
        self._taken_bytes += len(data)
        self._waiting.append((topic, data, log_time_ns))

    def close(self) -> None:
        """Write all accepted messages and close the bag; may be called again.

        Raises
        ------
        BagError
            If a message cannot be written, now or earlier.
        """
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        try:
            self._writer.close()
        except SoroError as error:
            self.failure = self.failure or error
        if self.failure is not None:
            raise self.failure

    def _run(self) -> None:
        flushed_s = time.monotonic()
        stopping = False
        while not stopping:
            # One more round after the stop writes the messages accepted before it.
            stopping = self._stop.wait(_GATHER_S)
            try:
                self._drain()
                if time.monotonic() - flushed_s >= self._flush_s:
                    flushed_s = time.monotonic()
                    self._writer.flush()
            except Exception as error:  # the thread must not die silently
                self.failure = (
                    error if isinstance(error, SoroError) else BagError(repr(error), self._writer.folder)
                )
                self.dropped += sum(isinstance(item, tuple) for item in self._waiting)
                self._waiting.clear()
                return

    def _drain(self) -> None:
        while self._waiting:
            item = self._waiting[0]
            if item is None:
                self._writer.split()
            elif isinstance(item, Topic):
                self._writer.add_topic(item)
            else:
                self._writer.write(*item)
                self._done_bytes += len(item[1])
            self._waiting.popleft()
