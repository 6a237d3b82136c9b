"""Repair of unfinished or damaged bags: readable data gets a new index and metadata.yaml."""

from __future__ import annotations

import os
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import cast

from soro_core.errors import BagError
from soro_lab.bag import metadata as bag_metadata
from soro_lab.bag.mcap.mcap_file import Compression, McapFile
from soro_lab.bag.mcap.part import BagFile
from soro_lab.bag.mcap.records import Damage
from soro_lab.bag.mcap.summary import open_part
from soro_lab.bag.metadata import FilePart, Metadata
from soro_lab.bag.reader import BagReader, load_metadata, part_files
from soro_lab.run_folder import bag_of

# What the index and the records of a file say alike.
_COMPARED = ("schemas", "channels", "counts", "message_indexes", "metadata", "attachments")


@dataclass(frozen=True, slots=True)
class PartRepair:
    """Result for one file."""

    path: Path
    """The file."""
    message_count: int
    """Messages that it has now."""
    rewritten: bool
    """Whether it was written anew."""
    problems: tuple[str, ...]
    """Why."""
    original: Path | None
    """The damaged file, where data was lost."""


def repair(path: str | Path) -> tuple[PartRepair, ...]:
    """Rewrite the unfinished or damaged files of a bag, of a run or alone, and its metadata.yaml.

    All readable messages keep their bytes and times, and by time their order. A file with lost data is kept
    beside the new one as ``NAME.damaged``. A sound file is not changed. A single MCAP file is repaired
    without metadata.yaml.

    Raises
    ------
    BagError
        If the path is not a bag, nothing can be read, or the disk refuses.
    """
    bag = bag_of(Path(path))
    before = load_metadata(bag, [])
    done = tuple(_repair_part(file) for file in _files(bag, before))
    if bag.is_dir():
        bag_metadata.save(_new_metadata(bag, before), bag)
    return done


def _files(bag: Path, before: Metadata | None) -> list[Path]:
    files = part_files(bag, before)
    for file in files:
        if file.suffix == ".zstd":
            raise BagError("compressed as a whole; unpack it first ('zstd -d')", file, "format")
        if file.suffix == ".db3":
            raise BagError("storage sqlite3; allowed: mcap ('ros2 bag convert' changes it)", file, "format")
    return files


def _repair_part(path: Path) -> PartRepair:
    part = open_part(path, index=False)
    draft = path.with_name(path.name + ".repair")
    try:
        if part.over:
            raise BagError(f"{part.over}: not repaired", path, "damaged")
        if _is_sound(part):
            return PartRepair(path, part.message_count, False, (), None)
        if part.private_count:
            part.lose(0, f"{part.private_count} records of private kinds")
        _rewrite(part, draft)
        # The original keeps the bytes that are left out.
        original = _free_name(path) if part.losses else None
        if original is not None:
            os.replace(path, original)
        os.replace(draft, path)
    except Damage as damage:
        raise BagError(f"{damage}: it changes while it is read", path, "damaged") from None
    except OSError as error:
        raise BagError(f"cannot be rewritten: {error.strerror}", path, "disk") from None
    finally:
        part.close()
        draft.unlink(missing_ok=True)
    return PartRepair(path, part.message_count, True, tuple(part.problems), original)


def _free_name(path: Path) -> Path:
    endings = (".damaged", *(f".damaged{number}" for number in range(2, 10_000)))
    return next(name for ending in endings if not (name := path.with_name(path.name + ending)).exists())


def _is_sound(walked: BagFile) -> bool:
    """Whether a file has an index that agrees with its records."""
    if walked.problems:
        return False
    part = open_part(walked.path)
    part.close()
    same = part.indexed and all(getattr(part, name) == getattr(walked, name) for name in _COMPARED)
    if not same or sorted(part.blocks, key=itemgetter(2)) != walked.blocks:
        walked.remark("the index is missing, leaves something out or is not that of the file")
        return False
    return True


def _rewrite(part: BagFile, draft: Path) -> None:
    """Write the messages of a part into a new file, in the order of the old one."""
    compression = cast(Compression, part.compression or "none")
    with draft.open("wb") as stream:
        file = McapFile(stream, compression, profile=part.profile)
        for name, values in part.metadata:
            file.add_metadata(name, values)
        channels = {channel_id: file.copy_channel(part, channel_id) for channel_id in part.channels}
        for block in part.blocks:
            for raw in part.messages(block):
                file.write(channels[raw.channel_id], raw.data, raw.log_time, raw.publish_time, raw.sequence)
        for place in part.attachments:
            file.add_attachment(part.attachment(place))
        file.flush()
        file.finish()
        stream.flush()
        os.fsync(stream.fileno())


def _recorded_metadata(part: BagFile) -> Metadata | None:
    """Return the metadata record of a file, which replaces a lost metadata.yaml."""
    for name, values in reversed(part.metadata):
        if name == "rosbag2" and "serialized_metadata" in values:
            try:
                return bag_metadata.parse_record(values["serialized_metadata"], str(part.path))
            except BagError:
                continue
    return None


def _new_metadata(bag: Path, before: Metadata | None) -> Metadata:
    with BagReader(bag) as reader:
        before = before or _recorded_metadata(reader.parts[0])
        files = []
        for part in reader.parts:
            span = part.span_ns()
            start, duration = (None, 0) if span is None else (span[0], span[1] - span[0])
            files.append(FilePart(part.path.name, start, duration, part.message_count))
        return Metadata(
            topics=tuple(zip(reader.topics, reader.counts, strict=True)),
            files=tuple(files),
            start_ns=reader.start_ns if reader.message_count else None,
            duration_ns=reader.end_ns - reader.start_ns,
            message_count=reader.message_count,
            ros_distro=before.ros_distro if before else "",
            custom_data=before.custom_data if before else {},
        )
