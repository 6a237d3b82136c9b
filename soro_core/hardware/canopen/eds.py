"""EDS files (CiA 306): the objects of a device, for the driver and the emulation."""

from __future__ import annotations

import functools
import io
import re
from configparser import RawConfigParser
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.eds import import_eds

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


# Keys whose values are numbers, by which the library fails without naming them.
_OF_THE_FILE = re.compile(
    r"VendorNumber|ProductNumber|RevisionNumber|SimpleBootUp\w+|Granularity|DynamicChannelsSupported|"
    r"GroupMessaging|NrOf[RT]XPDO|LSS_Supported|BaudRate_\d+|Lines|Baudrate|PDOMapping|Dummy\d+"
)
_OF_AN_OBJECT = re.compile(r"ObjectType|DataType|CompactSubObj|NrOfEntries|NodeID")


@dataclass(frozen=True)
class Entry:
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
def read_eds(path: Path, node: int) -> dict[Key, Entry]:
    """Return the entries of an EDS file by index and sub-index, for one node id.

    Raises
    ------
    ConfigError
        If the file is no EDS; where a value is wrong, with its section and key.
    """
    try:
        items = list(import_eds(io.StringIO(_text(path)), node).values())
    except ConfigError:
        raise
    except Exception as error:  # the library lets errors of parsing and conversion of every kind through
        text = " ".join(str(error).split()) or type(error).__name__
        raise ConfigError(str(path), "", text, "an EDS file (CiA 306)") from None
    variables = [v for item in items for v in ([item] if isinstance(item, ODVariable) else item.values())]
    return {(v.index, v.subindex): _entry(v) for v in variables if v.data_type in _TYPES}


@functools.cache
def _text(path: Path) -> str:
    """Return the text of the file without keys that have no value, which some editors write."""
    parser = RawConfigParser(inline_comment_prefixes=(";",))
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    with open(path, encoding="utf-8", errors="replace") as file:
        parser.read_file(file, str(path))
    for section in parser.sections():
        for key, value in parser.items(section):
            if not (_OF_THE_FILE.fullmatch(key) or _OF_AN_OBJECT.fullmatch(key)):
                continue
            try:
                parser.set(section, key, str(int(value or "0", 0)))
            except ValueError:
                raise ConfigError(str(path), f"[{section}] {key}", value, "a number") from None
            if not value and _OF_AN_OBJECT.fullmatch(key):  # not given: 0 would be a value
                parser.remove_option(section, key)
    text = io.StringIO()
    parser.write(text)
    return text.getvalue()


def _entry(variable: ODVariable) -> Entry:
    bits, is_signed = _TYPES[variable.data_type]
    return Entry(
        bits=bits,
        is_signed=is_signed,
        readable=variable.access_type != "wo",
        writable=variable.access_type in ("rw", "rww", "rwr", "wo"),
        mappable=variable.pdo_mappable,
        low=variable.min,
        high=variable.max,
        default=variable.default if isinstance(variable.default, int) else 0,
    )
