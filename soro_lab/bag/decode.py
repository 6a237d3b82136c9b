"""Messages read by the definition that their recording holds, with rosbags."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

from rosbags.interfaces import Nodetype
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

from soro_core.errors import BagError
from soro_lab.bag.topics import Topic, check_encoding

# Fields of each type that a definition has, with the names of types that generated Python classes have:
# ``{"std_msgs/Header": (("stamp", "builtin_interfaces/Time"), ("frame_id", "string"))}``.
Fields: TypeAlias = Mapping[str, tuple[tuple[str, str], ...]]

# Longest definition [B], most elements of a fixed array, most types within types: more can exhaust a reader.
_LONGEST, _LARGEST, _DEEPEST = 1 << 18, 1 << 16, 20
_RULE = "=" * 80 + "\n"
_NAMES = {"float64": "double", "float32": "float", "bool": "boolean", "byte": "octet", "char": "uint8"}

# Types of numbers of which every value is one of another type.
_NARROWER = {
    "double": ("float",),
    "int16": ("int8", "uint8"),
    "int32": ("int8", "uint8", "int16", "uint16"),
    "int64": ("int8", "uint8", "int16", "uint16", "int32", "uint32"),
    "uint16": ("uint8",),
    "uint32": ("uint8", "uint16"),
    "uint64": ("uint8", "uint16", "uint32"),
}


class Decoder:
    """Reads the messages of one topic of a bag.

    Parameters
    ----------
    topic : Topic
        Topic with its definition; without one, messages are read as those of ROS 2 Jazzy.
    bag : Path
        Where it is recorded, for errors.

    Attributes
    ----------
    fields : Fields
        Those of its type and of all types in it.

    Raises
    ------
    BagError
        If the messages are no CDR, or the definition cannot be read.
    """

    def __init__(self, topic: Topic, bag: Path) -> None:
        check_encoding(topic, bag)
        self._topic, self._bag, self._type = topic, bag, _full(topic.type)
        try:
            self._store, self.fields = _read(self._type, topic.definition, topic.definition_encoding)
        except (TypesysError, RecursionError, ValueError, KeyError) as error:
            text = f"the definition of {topic.type} cannot be read: {' '.join(str(error).split())[:120]}"
            raise BagError(text, bag, "format", topic.name) from None

    def __call__(self, data: bytes) -> Any:
        """Return a message with its fields as attributes; numbers in sequences are arrays of numpy.

        Raises
        ------
        BagError
            If the bytes are no such message.
        """
        try:
            if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
                raise ValueError(f"bytes {data[:4].hex(' ')}; allowed is plain CDR")
            if is_empty_message(data, not self.fields[_short(self._type)]):
                data = data + b"\0"
            return self._store.deserialize_cdr(data, self._type)
        except Exception as error:  # of generated code
            text = " ".join(str(error).split()) or type(error).__name__
            raise BagError(text, self._bag, "damaged", self._topic.name) from None


def is_empty_message(data: bytes, has_no_fields: bool) -> bool:
    """Whether a message without fields lacks the byte that most middlewares put in."""
    return has_no_fields and len(data) == 4


@lru_cache(maxsize=256)
def _read(name: str, text: str, encoding: str) -> tuple[Typestore, Fields]:
    if not text:
        store = get_typestore(Stores.ROS2_JAZZY)
        found = _with_parts(name, store.fielddefs)
    else:
        if len(text) > _LONGEST:
            raise ValueError(f"{len(text)} characters; allowed: up to {_LONGEST}")
        types: dict[str, Any] = {}
        if encoding == "ros2idl":
            # In MCAP a rule and a name stand before each definition.
            for part in filter(str.strip, text.split(_RULE)):
                types |= get_types_from_idl(part.partition("\n")[2] if part.startswith("IDL: ") else part)
        else:
            types |= get_types_from_msg(text, name)
        # Constants are no part of a message.
        found = _with_parts(name, {kind: ([], fields) for kind, (_, fields) in types.items()})
        store = Typestore()
        store.register(found)
    fields = {
        _short(kind): tuple((field, _text(desc)) for field, desc in listed)
        for kind, (_, listed) in found.items()
    }
    return store, fields


def _with_parts(name: str, types: Mapping[str, Any], within: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the definition of a type, and of the types in it."""
    if name not in types:
        raise KeyError(f"no definition of {name}")
    if len(within) > _DEEPEST:
        raise ValueError(f"more than {_DEEPEST} types within each other")
    found = {name: types[name]}
    for _, desc in types[name][1]:
        kind, content = desc
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            (kind, content), size = content
            if size > _LARGEST:
                raise ValueError(f"an array of {size}; allowed: up to {_LARGEST}")
        if kind == Nodetype.NAME and content in (*within, name):
            raise ValueError(f"{content} within itself")
        if kind == Nodetype.NAME and content not in found:
            found |= _with_parts(content, types, (*within, name))
    return found


def _text(desc: Any) -> str:
    """Return the name of a type as generated Python classes have it."""
    kind, content = desc
    if kind == Nodetype.NAME:
        return _short(content)
    if kind == Nodetype.BASE:
        name, bound = content
        return f"{_NAMES.get(name, name)}{f'<{bound}>' if bound else ''}"
    inner, size = _text(content[0]), content[1]
    if kind == Nodetype.ARRAY:
        return f"{inner}[{size}]"
    return f"sequence<{inner}, {size}>" if size else f"sequence<{inner}>"


def _full(name: str) -> str:
    package, _, rest = name.partition("/")
    return name if "/" in rest else f"{package}/msg/{rest}"


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


def element_of(text: str) -> str:
    """Return the name of the type of which a sequence or an array is one; of another type its own."""
    return text.removeprefix("sequence<").partition(",")[0].rstrip(">").partition("[")[0]


def holds(wanted: str, recorded: str) -> bool:
    """Whether a field holds every value of a recorded one; types are named as in `Fields`."""
    element = element_of(wanted)
    narrower = (wanted.replace(element, other) for other in _NARROWER.get(element, ()))
    return recorded == wanted or recorded in narrower
