"""A log of trips, resets and changed parameters that outlives runs: one bounded file of this user.

It is written by a thread of its own: neither a slow disk nor a folder that cannot be written holds up a node.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import queue
import threading
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from soro_core.files.private_folder import make_private
from soro_ros.host.latch_file import state_folder

# At most so many bytes are in the file [B]; the one before it is kept as well.
LARGEST = 1_000_000
# Longest text of an event [characters], and most events that wait for the disk.
_LONGEST, _WAITING = 1000, 1000
# Longest wait for the disk at the end of a process [s].
_CLOSE_S = 2.0


class LogEntry(NamedTuple):
    """One line of the log.

    Attributes
    ----------
    time : str
        UTC, ISO 8601.
    arm : str
        Namespace of the arm; ``/`` without one.
    node : str
        Name of the node.
    event : str
        ``vented``, ``not vented``, ``reset``, ``reset refused`` or ``parameter``; ``end`` where the last
        events of a node were left out.
    text : str
        Cause or values; at its end, in brackets, how many events were left out since the line before.
    """

    time: str
    arm: str
    node: str
    event: str
    text: str


def folder() -> Path:
    """Return the folder of the log."""
    return state_folder() / "log"


def files() -> tuple[Path, Path]:
    """Return the older file and the present one."""
    return folder() / "arms.1.log", folder() / "arms.log"


class EventLog:
    """Writes the events of one node.

    Parameters
    ----------
    arm : str
        Namespace of the arm.
    node : str
        Name of the node.
    warn : callable
        Called with one line, once, if an event cannot be written.
    """

    def __init__(self, arm: str, node: str, warn: Callable[[str], None]) -> None:
        self._arm, self._node, self._warn = arm, node, warn
        self._waiting: queue.Queue[LogEntry | None] = queue.Queue(_WAITING)
        self._thread: threading.Thread | None = None
        self._last: tuple[str, str] | None = None
        self._repeated, self._lost = 0, 0
        self._has_warned = False

    def note(self, event: str, text: str = "") -> None:
        """Log an event; at once the same again is left out, and counted in the next line."""
        if (event, text) == self._last:
            self._repeated += 1
        else:
            self._last = event, text
            self._put(event, text)

    def _put(self, event: str, text: str) -> None:
        counts = {"repeated": self._repeated, "lost because the disk was slow": self._lost}
        text = _with_left_out(" ".join(text.split())[:_LONGEST], counts)
        if self._thread is None:
            self._thread = threading.Thread(target=self._write_all, name="event log", daemon=True)
            self._thread.start()
        try:
            self._waiting.put_nowait(LogEntry(_now(), self._arm, self._node, event, text))
            self._repeated, self._lost = 0, 0
        except queue.Full:  # of a disk that stands still; the node goes on
            self._lost, self._last = self._lost + 1, None

    def close(self) -> None:
        """Write what waits, within some seconds; later events begin anew."""
        if self._repeated or self._lost:
            self._put("end", "")
        thread, self._thread, self._last = self._thread, None, None
        if thread is not None:
            with contextlib.suppress(queue.Full):
                self._waiting.put_nowait(None)
            thread.join(_CLOSE_S)

    def _write_all(self) -> None:
        refused = 0
        while (entry := self._waiting.get()) is not None:
            text = _with_left_out(entry.text, {"refused by the disk": refused})
            try:
                _append("\t".join(entry._replace(text=text)) + "\n")
                refused = 0
            except OSError as error:
                refused += 1
                if not self._has_warned:
                    self._has_warned = True
                    self._warn(f"no log of trips, resets and parameters in {folder()}: {error}")


def entries() -> Iterator[LogEntry]:
    """Yield what is in the log, the newest last; lines of another form are left out.

    Raises
    ------
    OSError
        If a file cannot be read.
    """
    for file in files():
        try:
            text = file.read_text(encoding="utf-8", errors="replace")
        except FileNotFoundError:
            continue
        for line in text.splitlines():
            parts = line.split("\t")
            if len(parts) == len(LogEntry._fields):
                yield LogEntry(*parts)


def _with_left_out(text: str, counts: Mapping[str, int]) -> str:
    """Return the text of a line with the numbers of events that were left out before it, by their reasons."""
    said = ", ".join(f"{count} {why}" for why, count in counts.items() if count)
    return f"{text} [left out before: {said}]".lstrip() if said else text


def _append(line: str) -> None:
    """Append a line; a file that is full becomes the older one. Processes wait for each other."""
    place = folder()
    place.parent.mkdir(parents=True, exist_ok=True)
    make_private(place, is_mended=True)
    older, file = files()
    data = line.encode(errors="backslashreplace")
    lock = os.open(place / "lock", os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with contextlib.suppress(FileNotFoundError):
            if file.stat().st_size + len(data) > LARGEST:
                file.replace(older)
        descriptor = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        try:
            before = os.fstat(descriptor).st_size
            if os.write(descriptor, data) < len(data):
                os.ftruncate(descriptor, before)  # else the next line would go on in this one
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        finally:
            os.close(descriptor)
    finally:
        os.close(lock)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
