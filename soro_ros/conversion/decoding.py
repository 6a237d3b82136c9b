"""Recorded messages, read by the definitions in their bag; what cannot be read is left out and counted."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from soro_core.errors import BagError
from soro_lab.bag import BagMessage, BagReader, Topic
from soro_lab.bag.decode import Decoder, Fields, element_of, holds, is_empty_message
from soro_lab.bag.topics import check_encoding
from soro_ros.conversion import learning
from soro_ros.conversion.interfaces import definition, message_class, type_name

Read = Callable[[bytes], Any]


class Messages:
    """The messages of some topics of a bag.

    Parameters
    ----------
    reader : BagReader
    kinds : mapping of str to type or None
        Topics, with the class that their messages must have. None: whatever the bag defines, as the installed
        class where that is the same, else as an object with its fields.

    Attributes
    ----------
    refused : dict of str to BagError
        Topics of which nothing can be read, and why.
    """

    def __init__(self, reader: BagReader, kinds: Mapping[str, type[Any] | None]) -> None:
        self._reader = reader
        self._read: dict[tuple[str, str], Read] = {}
        self._left_out: dict[str, tuple[int, BagError]] = {}
        self.refused: dict[str, BagError] = {}
        for topic in reader.topics:
            if topic.name not in kinds:
                continue
            try:
                self._read[topic.name, topic.type] = reading(topic, kinds[topic.name], reader.path)
            except BagError as error:
                self.refused[topic.name] = error

    def __call__(self, topics: Collection[str] | None = None) -> Iterator[tuple[BagMessage, Any]]:
        """Yield the recorded messages of some topics, all by default, each as it is and read."""
        self._left_out.clear()
        wanted = {name for name, _ in self._read if topics is None or name in topics}
        for item in self._reader.messages(wanted):
            if (message := self.read(item)) is not None:
                yield item, message

    def read(self, item: BagMessage) -> Any | None:
        """Return a recorded message; None if it cannot be read, which `left_out` counts."""
        read = self._read.get((item.topic, item.type))
        try:
            return None if read is None else read(item.data)
        except BagError as error:
            count, first = self._left_out.get(item.topic, (0, error))
            self._left_out[item.topic] = count + 1, first
            return None

    @property
    def left_out(self) -> list[str]:
        """A line for each topic of which messages were left out in the last reading."""
        return [
            f"left out: {topic}: {count} of {self._reader.count(topic)} messages that cannot be read: {first}"
            for topic, (count, first) in self._left_out.items()
        ]

    @property
    def problems(self) -> list[str]:
        """What was left out in the last reading: topics, messages, and what is damaged in the bag."""
        refused = [f"left out: {error}" for error in self.refused.values()]
        return [*(f"the bag is damaged: {line}" for line in self._reader.problems), *refused, *self.left_out]

    def need(self, topics: Iterable[str]) -> None:
        """Raise the BagError of the first of some topics of which nothing can be read."""
        for topic in sorted(topics):
            count, error = self._left_out.get(topic, (0, None))
            if topic in self.refused:
                raise self.refused[topic]
            if error is not None and count == self._reader.count(topic):
                raise error


def class_of(topic: Topic) -> type[Any] | None:
    """Return the class in which a recorded topic goes to nodes of today; None where it is not installed."""
    return JointState if _was_array(topic) else message_class(topic.type)


def _was_array(topic: Topic) -> bool:
    """Whether it is a topic of learning from before its messages had a header (ADR 0060)."""
    ends = tuple(f"/{name}" for name in learning.TOPICS)
    return topic.type == type_name(Float64MultiArray) and topic.name.endswith(ends)


def reading(topic: Topic, kind: type[Any] | None, bag: Path) -> Read:
    """Return the function that reads the messages of a topic from their bytes.

    Parameters
    ----------
    topic : Topic
    kind : type or None
        Class that the messages must have; None: see `Messages`.
    bag : Path
        Where it is recorded, for errors.

    Raises
    ------
    BagError
        If the messages are no CDR, the definition cannot be read, or is not that of the class.
    """
    check_encoding(topic, bag)
    if kind is JointState and _was_array(topic):
        before = reading(topic, Float64MultiArray, bag)
        return lambda data: _with_header(before(data), bag, topic.name)
    wanted = kind or message_class(topic.type)
    if wanted is None:
        if not topic.definition:
            text = f"type {topic.type} is not installed, and the bag does not define it"
            raise BagError(text, bag, "missing", topic.name)
        return Decoder(topic, bag)
    decoder, difference = _compared(topic, wanted, bag)
    if decoder is None:
        return lambda data: deserialised(data, wanted, bag, topic.name)
    if not difference:
        return lambda data: _as(wanted, decoder(data))
    if kind is None:
        return decoder
    raise _otherwise(topic, difference, bag)


def playing(topic: Topic, kind: type[Any], bag: Path) -> Callable[[bytes], bytes]:
    """Return the function that gives the bytes to publish from recorded ones.

    Parameters
    ----------
    topic : Topic
    kind : type
        Installed class of its messages.
    bag : Path
        Where it is recorded, for errors.

    Raises
    ------
    BagError
        As in `reading`.
    """
    check_encoding(topic, bag)
    if kind is JointState and _was_array(topic):
        read = reading(topic, kind, bag)
        return lambda data: bytes(serialize_message(read(data)))
    decoder, difference = _compared(topic, kind, bag)
    if decoder is None:
        return bytes
    if difference:
        raise _otherwise(topic, difference, bag)
    return lambda data: bytes(serialize_message(_as(kind, decoder(data))))


def _compared(topic: Topic, kind: type[Any], bag: Path) -> tuple[Decoder | None, str]:
    """Return what reads the messages of a topic, and why they cannot become those of a class.

    None: they are those of the class.
    """
    own = definition(topic.type)
    if not topic.definition:
        if topic.type_hash in ("", own.type_hash) or not own.type_hash:
            return None, ""
        raise _otherwise(topic, "the bag does not say how", bag)
    if topic.definition == own.text:
        return None, ""
    decoder, installed = Decoder(topic, bag), _layout(kind)
    if decoder.fields == installed:
        return None, ""
    return decoder, _difference(decoder.fields, installed)


def _with_header(message: Float64MultiArray, bag: Path, topic: str) -> JointState:
    try:
        return learning.from_array(message)
    except ValueError as error:
        raise BagError(str(error), bag, "damaged", topic) from None


def _otherwise(topic: Topic, difference: str, bag: Path) -> BagError:
    text = f"type {topic.type} was defined otherwise when it was recorded: {difference}"
    return BagError(text, bag, "value", topic.name)


def deserialised(data: bytes, kind: type[Any], bag: Path, topic: str) -> Any:
    """Return a recorded message of an installed class.

    Parameters
    ----------
    data : bytes
        Its serialised form.
    kind : type
        Its class.
    bag : Path
        Where it is recorded, for errors.
    topic : str
        Its topic, for errors.

    Raises
    ------
    BagError
        If the bytes are no such message.
    """
    if is_empty_message(data, not kind.get_fields_and_field_types()):
        return kind()
    try:
        return deserialize_message(data, kind)
    except Exception as error:  # of the middleware
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BagError(text, bag, "damaged", topic) from None


def _layout(kind: type[Any], found: dict[str, tuple[tuple[str, str], ...]] | None = None) -> Fields:
    """Return the fields of a class of messages, and of those in it."""
    found = {} if found is None else found
    fields = kind.get_fields_and_field_types()
    found[type_name(kind).replace("/msg/", "/")] = tuple(fields.items())
    for text in fields.values():
        name = element_of(text)
        if "/" in name and name not in found and (part := message_class(name)) is not None:
            _layout(part, found)
    return found


def _difference(recorded: Fields, installed: Fields) -> str:
    """Return what keeps recorded messages from becoming installed ones; "" if every field finds its place."""
    for name, fields in installed.items():
        if name not in recorded:
            return f"there was no {name}"
        before, now = dict(recorded[name]), dict(fields)
        for field in [*now, *before]:
            old, new = before.get(field, "missing"), now.get(field, "missing")
            if not holds(new, old):
                return f"{name}.{field} was {old}, and is {new}"
    return ""


def _as(kind: type[Any], value: Any) -> Any:
    """Return a message of a class with the fields of another one."""
    message = kind()
    for field, text in kind.get_fields_and_field_types().items():
        setattr(message, field, _converted(text, getattr(value, field)))
    return message


def _converted(text: str, value: Any) -> Any:
    element = element_of(text)
    if text != element:
        items = value.tolist() if hasattr(value, "tolist") else value
        return (
            [_converted(element, item) for item in items] if "/" in element or element == "octet" else items
        )
    if "/" in element:
        found = message_class(element)
        assert found is not None
        return _as(found, value)
    return bytes([value]) if element == "octet" else value
