"""EDS files (CiA 306): the objects of a device, for the driver and the emulation.

They are not read by the package canopen: it leaves out sections and values that it cannot read.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Mapping
from configparser import Error, RawConfigParser
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, TypeAlias

from soro_core.errors import ConfigError

Key: TypeAlias = tuple[int, int]

# CiA 306 data types: bits and sign. Others (texts, domains) carry no value of a regulator and are left out.
_TYPES = {
    1: (8, False),
    2: (8, True),
    3: (16, True),
    4: (32, True),
    5: (8, False),
    6: (16, False),
    7: (32, False),
}
_DOMAIN, _VARIABLE, _ARRAY, _RECORD = 2, 7, 8, 9
_LARGEST_TYPE = 0x1B
_ACCESS = ("ro", "wo", "rw", "rwr", "rww", "const")
_WRITABLE = ("wo", "rw", "rwr", "rww")

_OBJECT = re.compile(r"([0-9A-F]{4})(?:SUB([0-9A-F]{1,2}))?")
_LISTS = {"MANDATORYOBJECTS", "OPTIONALOBJECTS", "MANUFACTUREROBJECTS"}
# Names and values of compact objects, and links between objects.
_BESIDE = re.compile(r"[0-9A-F]{4}(NAME|VALUE|DENOTATION|OBJECTLINKS)")
_LIKE_AN_OBJECT = re.compile(r"(0X)?([0-9A-F]{2,}|(?=.{0,3}[0-9])[0-9A-F]{4}.*)")
# Keys of no object whose values are numbers.
_NUMBERS = re.compile(
    r"vendornumber|productnumber|revisionnumber|simplebootup\w+|granularity|dynamicchannelssupported|"
    r"groupmessaging|nrof[rt]xpdo|lss_supported|baudrate_\d+|lines|baudrate|nodeid|dummy\d+"
)
_NODE = re.compile(r"\+?\$NODEID\+?")


@dataclass(frozen=True)
class ObjectEntry:
    """One object of an EDS."""

    bits: int
    is_signed: bool
    readable: bool
    writable: bool
    mappable: bool
    low: int | None
    high: int | None
    default: int


@functools.cache
def read_eds(path: Path, node: int) -> dict[Key, ObjectEntry]:
    """Return the entries of an EDS file by index and sub-index, for one node id.

    Raises
    ------
    ConfigError
        If the file is no EDS; where a section or a value cannot be read, with its section and key.
    """
    sections = _sections(path)
    found: dict[Key, ObjectEntry] = {}
    for section in sections.values():
        match = _OBJECT.fullmatch(section.name.upper())
        if match is None:
            _check(section)
            continue
        for key, entry in _entries(section, match[1], match[2], sections, node):
            if entry is not None:
                found[key] = entry
    _require_whole(sections)
    return found


@dataclass(frozen=True)
class _Section:
    """A section: its values by key in small letters, and its keys as the file writes them."""

    path: Path
    name: str
    values: Mapping[str, str]
    written: Mapping[str, str]

    def refuse(self, key: str, got: object, allowed: str) -> NoReturn:
        key = self.written.get(key, key)
        raise ConfigError(str(self.path), f"[{self.name}] {key}".strip(), got, allowed)

    def number(self, key: str, default: int | None = None, node: int = 0) -> int:
        """Return the whole number of a key, decimal or hexadecimal, or the default where none is given."""
        given = self.values.get(key.lower(), "").partition(";")[0].strip()
        if not given and default is not None:
            return default
        text, count = _NODE.subn("", "".join(given.split()).upper())
        value = node if count == 1 and not text else _whole(text)
        if value is None or count > 1:
            self.refuse(key, given or "nothing", "a whole number")
        if re.fullmatch(r"[+-]?0[0-7]*", text) and int(text, 8) != value:
            self.refuse(key, given, "a number without leading zeros: some programs read it as octal")
        return value + node if count and text else value

    def value(self, key: str, bits: int, is_signed: bool, node: int) -> int | None:
        """Return a value of the object, or None; one with a sign may be written as its bits."""
        if not self.values.get(key.lower(), "").partition(";")[0].strip():
            return None
        value = self.number(key, node=node)
        top = 1 << (bits - is_signed)
        if is_signed and top <= value < 2 * top:
            value -= 2 * top
        if not -top * is_signed <= value < top:
            sign = "with" if is_signed else "without"
            self.refuse(key, self.values[key.lower()], f"a number of {bits} bits {sign} sign")
        return value


def _sections(path: Path) -> dict[str, _Section]:
    """Return the sections by name in capital letters."""
    parser = RawConfigParser(inline_comment_prefixes=(";",))
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    found: dict[str, _Section] = {}
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
        # Spaces before a key would make its line a part of the value before.
        parser.read_string("\n".join(line.strip() for line in lines), str(path))
    except (OSError, Error) as error:
        text = " ".join(str(error).replace(repr(str(path)), "").split())
        raise ConfigError(str(path), "", text, "an EDS file (CiA 306)") from None
    for written in parser.sections():
        items = parser.items(written)
        values, names = {key.lower(): text for key, text in items}, {key.lower(): key for key, _ in items}
        section = _Section(path, written.strip(), values, names)
        if len(values) < len(items):
            section.refuse("", "a key twice", "each key once")
        if found.setdefault(section.name.upper(), section) is not section:
            section.refuse("", "a section of this name before", "one section for each object")
    if not any(_OBJECT.fullmatch(name) for name in found):
        raise ConfigError(str(path), "", "no section of an object", "an EDS file (CiA 306)")
    return found


def _require_whole(sections: Mapping[str, _Section]) -> None:
    """Refuse a file that ends before its last object, or lists an object that it does not have."""
    for name in _LISTS & sections.keys():
        for key in filter(str.isdigit, sections[name].values):
            if f"{(index := sections[name].number(key)):04X}" not in sections:
                sections[name].refuse(key, f"0x{index:04X}", "objects with a section each; is the file cut?")
    last = [name for name in sections if _OBJECT.fullmatch(name)][-1][:4]
    if last not in sections or sections[last].number("CompactSubObj", 0):
        return
    parts = sum(name.startswith(f"{last}SUB") for name in sections)
    if parts < (stated := sections[last].number("SubNumber", 0)):
        sections[last].refuse("SubNumber", stated, f"{parts}, as there are; is the file cut?")


def _check(section: _Section) -> None:
    """Refuse a section that may be an object in a wrong writing, and numbers that are none."""
    name = section.name.upper()
    if _LIKE_AN_OBJECT.fullmatch(name) and not _BESIDE.fullmatch(name):
        section.refuse("", "no index", "four hexadecimal digits, as [1018] or [1018sub1]")
    for key, text in section.values.items():
        if _NUMBERS.fullmatch(key) and text and _whole(text.partition(";")[0].strip().upper()) is None:
            section.refuse(key, text, "a whole number")


def _entries(
    section: _Section, index: str, sub: str | None, sections: Mapping[str, _Section], node: int
) -> Iterator[tuple[Key, ObjectEntry | None]]:
    """Yield the objects of a section; None for one whose type carries no value of a regulator."""
    at = int(index, 16)
    if sub is not None:
        if index not in sections:
            section.refuse("", f"no section [{index}]", "a section of each object with sub-indices")
        yield (at, int(sub, 16)), _entry(section, sections, node)
        return
    has_parts = any(name.startswith(f"{index}SUB") for name in sections)
    kind = section.number("ObjectType", _RECORD if has_parts else _VARIABLE)
    compact = section.number("CompactSubObj", 0)
    if has_parts and kind in (_DOMAIN, _VARIABLE):
        section.refuse("ObjectType", kind, f"{_ARRAY} or {_RECORD} of an object with sub-indices")
    if kind in (_DOMAIN, _VARIABLE):
        yield (at, 0), _entry(section, sections, node)
    elif compact:
        yield (at, 0), ObjectEntry(8, False, True, False, False, None, None, compact)
        for k in range(1, compact + 1):
            yield (at, k), _entry(section, sections, node)


def _entry(section: _Section, sections: Mapping[str, _Section], node: int) -> ObjectEntry | None:
    kind = section.number("DataType")
    if kind > _LARGEST_TYPE and f"{kind:X}SUB1" in sections:  # a range, as CANFestival writes it
        kind = sections[f"{kind:X}SUB1"].number("DefaultValue")
    access = section.values.get("accesstype", "").partition(";")[0].strip().lower()
    if access not in _ACCESS:
        section.refuse("AccessType", access or "nothing", f"one of {', '.join(_ACCESS)}")
    mappable = bool(section.number("PDOMapping", 0))
    if kind not in _TYPES:
        return None
    bits, is_signed = _TYPES[kind]
    low, high, default = (
        section.value(key, bits, is_signed, node) for key in ("LowLimit", "HighLimit", "DefaultValue")
    )
    return ObjectEntry(
        bits, is_signed, access != "wo", access in _WRITABLE, mappable, low, high, default=default or 0
    )


def _whole(text: str) -> int | None:
    """Return the whole number of a text in capital letters, also of 2.0; None of another text."""
    if re.fullmatch(r"[+-]?0X[0-9A-F]+", text):
        return int(text, 16)
    match = re.fullmatch(r"([+-]?[0-9]+)(\.0*)?", text)
    return int(match[1]) if match else None
