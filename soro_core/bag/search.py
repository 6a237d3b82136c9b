"""Search for the next record behind bytes of a file that are none."""

from __future__ import annotations

import re
import struct
from bisect import bisect_right
from collections.abc import Sequence

from mcap.opcode import Opcode

from soro_core.bag.part import Part
from soro_core.bag.records import PREFIX, Prefix

# Begin of a message: kind, length, channel, sequence, log time; and its least length [B].
MESSAGE = struct.Struct("<BQHIQ")
LEAST_MESSAGE = 22
# Messages behind each other are at most this far apart [ns].
_NEAR_NS = 3600 * 10**9
# Kind, length, times, size, checksum and compression of a chunk; or the end of the data.
_CHUNK = re.compile(
    rb"\x06(?=.{5}\0{3}.{22}\0\0.{4}(?:\x04\0{3}zstd|\x03\0{3}lz4|\0{4}).{6}\0\0)"
    rb"|\x0f(?=\x04\0{7}.{4}[\x02-\x0e])",
    re.DOTALL,
)
_LOOSE = re.compile(rb"\x05(?=.{5}\0{3})", re.DOTALL)
_WINDOW, _LARGEST_WINDOW, _OVERLAP = 1 << 16, 1 << 22, 80
_MOST_SEARCHES, _MOST_TRIES = 2000, 500_000


class Search:
    """Finds where records begin, by the index of the file or by their looks.

    Parameters
    ----------
    part : Part
        The file; what it describes says which messages it may have.
    places : sequence of int
        Where the index says that records begin, in their order [B].
    """

    def __init__(self, part: Part, places: Sequence[int]) -> None:
        self._part, self._source, self._places = part, part.source, places
        self._searches = self._tries = 0

    def next(self, position: int, has_chunks: bool) -> int | None:
        """Return where the next record begins; None for nowhere.

        Parameters
        ----------
        position : int
            Of the bytes that are none [B].
        has_chunks : bool
            Whether messages are in chunks.
        """
        self._searches += 1
        if self._searches > _MOST_SEARCHES:
            self._part.over = f"more than {_MOST_SEARCHES} damaged places"
            return self._part.size
        first = bisect_right(self._places, position)
        later = (self._places[k] for k in range(first, len(self._places)))
        place = next((place for place in later if self._source.begins_record(place)), None)
        if place is not None and has_chunks:
            return place
        found = None if self._places else self._find(position + 1, _CHUNK)
        if found is None and not has_chunks:
            found = self._find(position + 1, _LOOSE)
        return min((each for each in (place, found) if each is not None), default=None)

    def is_next(self, prefix: Prefix) -> bool:
        """Whether a message is followed by another one, whatever that one's kind and length say."""
        if prefix.opcode != Opcode.MESSAGE or not self._is_message(prefix):
            return False
        channel_id, log_time = self._head(prefix.end)
        return channel_id in self._part.channels and abs(log_time - self._head(prefix.start)[1]) < _NEAR_NS

    def _find(self, position: int, pattern: re.Pattern[bytes]) -> int | None:
        source, size, length = self._source, self._part.size, _WINDOW
        while position < size:
            window = source.bytes(position, min(position + length + _OVERLAP, size))
            for match in pattern.finditer(window):
                self._tries += 1
                if match.start() >= length or self._tries > _MOST_TRIES:
                    break
                prefix = source.prefix(position + match.start())
                if prefix is None or prefix.end > size or not source.begins_record(prefix.end, is_cut=True):
                    continue
                if prefix.opcode != Opcode.MESSAGE or self._is_message(prefix):
                    return prefix.start
            position, length = position + length, min(2 * length, _LARGEST_WINDOW)
        return None

    def _is_message(self, prefix: Prefix) -> bool:
        if prefix.end - prefix.start < PREFIX.size + LEAST_MESSAGE:
            return False
        return self._head(prefix.start)[0] in self._part.channels

    def _head(self, position: int) -> tuple[int, int]:
        """Return channel and log time of a message at a position."""
        raw = self._source.bytes(position, min(position + MESSAGE.size, self._part.size))
        return MESSAGE.unpack(raw.ljust(MESSAGE.size, b"\0"))[2::2]
