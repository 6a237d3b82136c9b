"""Message definitions and type hashes from the share folders of installed ROS packages."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from soro_core.errors import BagError

_PRIMITIVE = re.compile(r"^(bool|byte|char|float(32|64)|u?int(8|16|32|64)|w?string)$")
_TYPE = re.compile(r"^([A-Za-z]\w*)/(?:(msg|srv|action)/)?([A-Za-z]\w*)$")
_IDL_INCLUDE = re.compile(r"^#include\s+[\"<]([\w/]+)\.idl[\">]", re.MULTILINE)
_RULE = "=" * 80


@dataclass(frozen=True, slots=True)
class Definition:
    """Definition of a message type."""

    text: str
    """The type, and every type that it refers to."""
    encoding: str
    """Language of the text, `ros2msg` or `ros2idl`; empty without a text."""
    type_hash: str
    """RIHS01 hash."""


def find_definition(type_name: str, shares: Iterable[Path]) -> Definition:
    """Return the definition of a message type.

    Parameters
    ----------
    type_name : str
        ``sensor_msgs/msg/JointState``.
    shares : iterable of Path
        Folders that hold ``<package>/msg/<Name>.msg`` and ``.json``, in the order of search.

    Returns
    -------
    Definition
        Definition, with empty texts if the type is not installed. The text is that of rosbag2: depth first,
        the referenced types of a message in alphabetical order, each once.
    """
    folders = tuple(shares)
    try:
        text = _collect(type_name, folders, ".msg", set())
        encoding = "ros2msg"
    except FileNotFoundError:
        try:
            text = f"{_RULE}\nIDL: {type_name}\n" + _collect(type_name, folders, ".idl", set())
            encoding = "ros2idl"
        except FileNotFoundError:
            text, encoding = "", ""
    return Definition(text, encoding, _type_hash(type_name, folders))


def _collect(type_name: str, shares: Sequence[Path], ending: str, seen: set[str]) -> str:
    package, _, _ = _split(type_name)
    text = _read(type_name, shares, ending)
    used = _used_by_msg(text, package) if ending == ".msg" else set(_IDL_INCLUDE.findall(text))
    kind = ending[1:].upper()
    for name in sorted(used):
        if name not in seen:
            seen.add(name)
            text += f"\n{_RULE}\n{kind}: {name}\n" + _collect(name, shares, ending, seen)
    return text


def _used_by_msg(text: str, package: str) -> set[str]:
    """Return the names of the types in a .msg file (``std_msgs/Header``)."""
    used = set()
    for line in text.splitlines():
        fields = line.split("#", 1)[0].split()
        if len(fields) < 2:
            continue
        name = re.split(r"[\[<]", fields[0], maxsplit=1)[0]
        if not _PRIMITIVE.match(name):
            used.add(name if "/" in name else f"{package}/{name}")
    return used


def _split(type_name: str) -> tuple[str, str, str]:
    match = _TYPE.match(type_name)
    if match is None:
        raise BagError("allowed: package/msg/Name", place=f"type {type_name!r}", code="value")
    return match[1], match[2] or "msg", match[3]


def _find(type_name: str, shares: Sequence[Path], ending: str) -> Path | None:
    package, kind, name = _split(type_name)
    for share in shares:
        path = share / package / kind / f"{name}{ending}"
        if path.is_file():
            return path
    return None


def _read(type_name: str, shares: Sequence[Path], ending: str) -> str:
    path = _find(type_name, shares, ending)
    if path is None:
        raise FileNotFoundError(type_name)
    # newline="" keeps the bytes of the file, as rosbag2 does.
    with path.open(encoding="utf-8", newline="") as stream:
        return stream.read()


def _type_hash(type_name: str, shares: Sequence[Path]) -> str:
    path = _find(type_name, shares, ".json")
    if path is None:
        return ""
    package, kind, name = _split(type_name)
    try:
        hashes = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
        table = {entry["type_name"]: str(entry["hash_string"]) for entry in hashes}
    except (OSError, ValueError, KeyError, TypeError):
        return ""
    return table.get(f"{package}/{kind}/{name}", "")
