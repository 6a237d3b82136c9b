"""EDS files (CiA 306): which objects a device has; the driver checks them, the emulation serves them."""

from __future__ import annotations

import functools
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


@dataclass(frozen=True)
class Entry:
    """What the EDS says of one sub-object."""

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
    """Entries of an EDS file by index and sub-index, for one node id.

    Raises
    ------
    ConfigError
        If the file is no EDS.
    """
    try:
        items = list(import_eds(str(path), node).values())
    except Exception as error:  # the library lets errors of parsing and conversion of every kind through
        text = " ".join(str(error).split()) or type(error).__name__
        raise ConfigError(str(path), "", text, "an EDS file (CiA 306)") from None
    variables = [v for item in items for v in ([item] if isinstance(item, ODVariable) else item.values())]
    return {(v.index, v.subindex): _entry(v) for v in variables if v.data_type in _TYPES}


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
