"""Reading an MCAP file record by record, for unfinished or damaged files and files without an index."""

from __future__ import annotations

from soro_core.bag.collect import DATA, Collector
from soro_core.bag.part import Part
from soro_core.bag.prefixes import (
    RecordPrefix,
    find,
    fits,
    has_record,
    is_plausible,
    may_continue,
    one_bit_variants,
    read_prefix,
)
from soro_core.bag.records import CHUNK, MAGIC, MESSAGE, PREFIX, PRIVATE, Damage, message_key, parse
from soro_core.errors import BagError


def scan(part: Part, proven: bool = False) -> None:
    """Fill a Part from the records of its file.

    Damaged data is left out up to the next consistent record, and noted as a problem of the part. A single
    flipped bit in the prefix of a record, in the head of a chunk or in an uncompressed chunk with a checksum
    is corrected.

    Parameters
    ----------
    part : Part
        The part to fill; its `schemas` and `channels` may hold those of the index.
    proven : bool
        Whether a checksum proves these: they then take precedence over records that contradict them.

    Raises
    ------
    BagError
        If nothing can be read.
    """
    collector = Collector(part, proven)
    position = len(MAGIC)
    while position < part.size and not collector.finished:
        position = _step(part, collector, position)
    collector.close()
    if position == len(MAGIC):
        raise BagError("damaged: its header cannot be read", part.path, "damaged")
    _note_end(part, collector, position)


def _step(part: Part, collector: Collector, position: int) -> int:
    """Add the record at a position; return the position of the next one."""
    prefix = read_prefix(part, position)
    if prefix is not None:
        damage: Damage | str = f"a record of the unknown kind {prefix.opcode}"
        may_stand = fits(part, prefix)
        follows_on = may_stand and may_continue(part, prefix.end)
        is_known = may_stand and prefix.opcode < PRIVATE
        # The content of a message does not prove its position.
        if is_known and (follows_on or prefix.opcode != MESSAGE) and _adds(collector, prefix):
            return prefix.end
        if (other := _add_corrected(part, collector, prefix, follows_on)) is not None:
            part.note(position, "one bit in the kind or length of a record was corrected", left_out=False)
            return other.end
        if is_known and follows_on:
            try:
                collector.take(prefix, exact=False)
                return prefix.end
            except Damage as error:
                damage = error
        if follows_on:
            if prefix.opcode >= PRIVATE:
                part.private_count += 1
            elif not collector.data_ended:
                part.note(position, damage)
            if prefix.opcode == CHUNK:
                collector.index = None
            return prefix.end
    found = find(part, position + 1, lambda other: _is_record_of_file(part, collector, other))
    if found is not None:
        collector.index = None
        part.note(position, f"{found.position - position} bytes cannot be read")
        return found.position
    if position == len(MAGIC):
        raise BagError("damaged: its header cannot be read", part.path, "damaged")
    if not collector.data_ended:
        _cut(part, collector, position, prefix)
    return part.size


def _add_corrected(
    part: Part, collector: Collector, prefix: RecordPrefix, follows_on: bool
) -> RecordPrefix | None:
    """Add the record whose prefix differs in one bit; return its prefix, or None without such a record."""
    for other in one_bit_variants(prefix):
        if follows_on and prefix.opcode >= PRIVATE and other.length != prefix.length:
            break  # a record follows, so the length is correct
        if not (fits(part, other) and other.opcode < PRIVATE and may_continue(part, other.end)):
            continue
        if not is_plausible(prefix, other) or (other.opcode == MESSAGE and not has_record(part, other.end)):
            continue
        if _adds(collector, other, prefix_is_right=False):
            return other
    return None


def _adds(collector: Collector, prefix: RecordPrefix, prefix_is_right: bool = True) -> bool:
    try:
        collector.take(prefix, True, prefix_is_right)
    except Damage:
        return False
    return True


def _is_record_of_file(part: Part, collector: Collector, prefix: RecordPrefix) -> bool:
    """Whether bytes behind damage are a record of the file, not one inside an uncompressed chunk."""
    if prefix.opcode not in DATA:
        return False
    try:
        body = part.read(prefix.position, PREFIX.size + prefix.length)[PREFIX.size :]
        if prefix.opcode == MESSAGE:
            is_chunked = bool(part.chunks) or collector.index is not None
            return not is_chunked and message_key(body)[0] in part.channels
        parse(prefix.opcode, body, exact=True)
    except Damage:
        return False
    return True


def _cut(part: Part, collector: Collector, position: int, prefix: RecordPrefix | None) -> None:
    """Note that the rest of the file is unreadable; add the readable messages of a last, cut chunk."""
    collector.close()
    part.lossy = True
    is_chunk = prefix is not None and prefix.opcode == CHUNK
    saved = collector.take_cut_chunk(position) if is_chunk else 0
    kept = f"; {saved} messages of the last chunk were saved" if saved else ""
    place = f"no whole record from byte {position} of {part.size} on"
    part.problems.append(f"{part.path.name}: the end is missing: {place}{kept}")


def _note_end(part: Part, collector: Collector, position: int) -> None:
    """Note what is missing at the end of the file."""
    name = part.path.name
    if collector.unknown:
        part.lossy = True
        channels = ", ".join(map(str, sorted(collector.unknown)[:10]))
        count = collector.unknown.total()
        part.problems.append(f"{name}: {count} messages of unknown channels ({channels}); left out")
    rest = part.size - position
    if collector.finished and bytes(part.read(position, min(len(MAGIC), rest))) == MAGIC:
        if not collector.data_ended:
            part.problems.append(f"{name}: the end of the data is not marked")
        if rest > len(MAGIC):
            extra = f"{rest - len(MAGIC)} bytes behind the end of the recording"
            part.note(position + len(MAGIC), extra)
    elif not collector.data_ended:
        part.problems.append(f"{name}: not closed by its recorder: the index is missing")
    elif bytes(part.read(part.size - len(MAGIC), len(MAGIC))) != MAGIC:
        part.problems.append(f"{name}: the index at the end is cut; all messages are there")
    elif not part.problems:
        part.problems.append(f"{name}: the index at the end is damaged; all messages are there")
