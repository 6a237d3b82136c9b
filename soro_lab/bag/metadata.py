"""metadata.yaml of rosbag2: read in all its versions, written in version 9 (ROS 2 Jazzy)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from soro_core.errors import BagError
from soro_lab.bag.topics import Topic, load_yaml, qos_from

VERSION = 9
# rosbag2 writes the largest time for a bag without messages.
_NO_START_NS = 2**63 - 1


@dataclass(frozen=True, slots=True)
class FilePart:
    """One file of a bag: name, time of its first message, duration, messages."""

    path: str
    start_ns: int | None
    duration_ns: int
    message_count: int


@dataclass(frozen=True, slots=True)
class Metadata:
    """Contents of metadata.yaml."""

    topics: tuple[tuple[Topic, int], ...]
    """Topics, each with its number of messages."""
    files: tuple[FilePart, ...]
    """Files in the order of their times."""
    start_ns: int | None = None
    """Time of the first message [ns]; None for a bag without messages."""
    duration_ns: int = 0
    """From the first message to the last [ns]."""
    message_count: int = 0
    """Messages of all topics."""
    version: int = VERSION
    """Version of the format of metadata.yaml."""
    storage: str = "mcap"
    """Name of the storage plug-in of rosbag2."""
    compression_format: str = ""
    """Name of the compression; empty for none."""
    compression_mode: str = ""
    """What is compressed as one, file or message; empty for none."""
    ros_distro: str = "jazzy"
    """Distribution of ROS that recorded the bag."""
    custom_data: Mapping[str, str] = field(default_factory=dict)
    """What the recorder adds, by name."""


def dump(metadata: Metadata) -> str:
    """Return the text of metadata.yaml, version 9."""
    return _yaml({"rosbag2_bagfile_information": _as_map(metadata)})


def dump_record(metadata: Metadata) -> str:
    """Return the text of the MCAP metadata record ``rosbag2``."""
    return _yaml(_as_map(metadata)).rstrip("\n")


def save(metadata: Metadata, folder: Path) -> None:
    """Replace metadata.yaml in a bag's folder atomically."""
    path = folder / "metadata.yaml"
    draft = folder / "metadata.yaml.tmp"
    try:
        with draft.open("w", encoding="utf-8") as stream:
            stream.write(dump(metadata))
            stream.flush()
            os.fsync(stream.fileno())
        draft.replace(path)
    except OSError as error:
        raise BagError(f"cannot be written: {error.strerror}", path, "disk") from None


def parse(text: str, where: str) -> Metadata:
    """Read metadata.yaml of any version.

    Raises
    ------
    BagError
        One line that names `where` and what is wrong.
    """
    document = _load(text, where)
    if not isinstance(document, Mapping) or "rosbag2_bagfile_information" not in document:
        raise BagError("key rosbag2_bagfile_information is missing", where, "value")
    return _from_map(document["rosbag2_bagfile_information"], where)


def parse_record(text: str, where: str) -> Metadata:
    """Read the text of the MCAP metadata record ``rosbag2``; errors as in `parse`."""
    return _from_map(_load(text, where), where)


def _load(text: str, where: str) -> Any:
    try:
        return load_yaml(text)
    except yaml.YAMLError as error:
        raise BagError(f"no valid YAML: {' '.join(str(error).split())[:120]}", where, "damaged") from None


def _as_map(metadata: Metadata) -> dict[str, Any]:
    return {
        "version": VERSION,
        "storage_identifier": metadata.storage,
        "duration": {"nanoseconds": metadata.duration_ns},
        "starting_time": _start(metadata.start_ns),
        "message_count": metadata.message_count,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": topic.serialization_format,
                    "offered_qos_profiles": [qos.as_map() for qos in topic.qos],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": count,
            }
            for topic, count in metadata.topics
        ],
        "compression_format": metadata.compression_format,
        "compression_mode": metadata.compression_mode,
        "relative_file_paths": [part.path for part in metadata.files],
        "files": [
            {
                "path": part.path,
                "starting_time": _start(part.start_ns),
                "duration": {"nanoseconds": part.duration_ns},
                "message_count": part.message_count,
            }
            for part in metadata.files
        ],
        "custom_data": dict(metadata.custom_data) or None,
        "ros_distro": metadata.ros_distro,
    }


def _start(start_ns: int | None) -> dict[str, int]:
    return {"nanoseconds_since_epoch": _NO_START_NS if start_ns is None else start_ns}


def _from_map(info: Mapping[str, Any], where: str) -> Metadata:
    try:
        return _checked(info, where)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise BagError(f"{type(error).__name__} {error}", where, "value") from None


def _checked(info: Mapping[str, Any], where: str) -> Metadata:
    version = int(info["version"])
    if version > VERSION:
        raise BagError(f"got {version}; allowed: 1 to {VERSION}", where, "format", "version")
    topics = []
    for entry in info["topics_with_message_count"]:
        about = entry["topic_metadata"]
        topic = Topic(
            name=str(about["name"]),
            type=str(about["type"]),
            type_hash=str(about.get("type_description_hash") or ""),
            qos=qos_from(about.get("offered_qos_profiles"), where),
            serialization_format=str(about["serialization_format"]),
        )
        topics.append((topic, int(entry["message_count"])))
    count = int(info["message_count"])
    start = int(info["starting_time"]["nanoseconds_since_epoch"]) if count else None
    duration = int(info["duration"]["nanoseconds"])
    parts = [
        FilePart(
            str(part["path"]),
            int(part["starting_time"]["nanoseconds_since_epoch"]) if part["message_count"] else None,
            int(part["duration"]["nanoseconds"]),
            int(part["message_count"]),
        )
        for part in info.get("files") or ()
    ]
    if not parts:
        parts = [FilePart(str(path), None, 0, 0) for path in info["relative_file_paths"]]
    return Metadata(
        topics=tuple(topics),
        files=tuple(parts),
        start_ns=start,
        duration_ns=duration,
        message_count=count,
        version=version,
        storage=str(info["storage_identifier"]),
        compression_format=str(info.get("compression_format") or ""),
        compression_mode=str(info.get("compression_mode") or "").lower(),
        ros_distro=str(info.get("ros_distro") or ""),
        custom_data={str(key): str(value) for key, value in (info.get("custom_data") or {}).items()},
    )


class _Dumper(yaml.SafeDumper):
    """Block style with indented lists, no aliases, and ``~`` for null, as yaml-cpp writes."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)

    def ignore_aliases(self, data: Any) -> bool:
        return True


_Dumper.add_representer(
    type(None), lambda dumper, value: dumper.represent_scalar("tag:yaml.org,2002:null", "~")
)


def _yaml(value: Mapping[str, Any]) -> str:
    text: str = yaml.dump(
        value, Dumper=_Dumper, sort_keys=False, default_flow_style=False, allow_unicode=True, width=10**6
    )
    return text
