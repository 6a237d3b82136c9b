"""Topics of a bag: name, type, definition and quality of service of the publishers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from soro_core.errors import BagError

# Largest signed 64-bit number of nanoseconds: rmw's infinite duration.
INFINITE_NS = 2**63 - 1

# Values of the rmw enumerations, by which bags up to metadata version 8 name the policies.
_POLICIES: dict[str, tuple[str, ...]] = {
    "history": ("system_default", "keep_last", "keep_all", "unknown"),
    "reliability": ("system_default", "reliable", "best_effort", "unknown", "best_available"),
    "durability": ("system_default", "transient_local", "volatile", "unknown", "best_available"),
    "liveliness": (
        "system_default",
        "automatic",
        "manual_by_node",
        "manual_by_topic",
        "unknown",
        "best_available",
    ),
}
# Largest number of levels in YAML; metadata.yaml has eight.
_MAX_DEPTH = 20
# Longest YAML; that of a thousand topics has 0.6 MB.
_MOST_TEXT = 1 << 21
# In place of the encoding of a definition, where files or channels of a bag contradict each other.
SEVERAL = "several"
_ENCODINGS = {"json": "JSON", "ros1": "ROS 1", "protobuf": "Protobuf", "flatbuffer": "FlatBuffers"}
_QOS_KEY = "offered_qos_profiles"
# What middlewares of before 2021 wrote for an infinite duration.
_OLD_INFINITE = ((0x7FFFFFFF, 0xFFFFFFFF), (0x7FFFFFFF, 0x7FFFFFFF))


@dataclass(frozen=True, slots=True)
class Span:
    """A duration in the form of rmw, unchanged: readers compare its two copies in a bag."""

    sec: int = INFINITE_NS // 10**9
    """Whole seconds [s]."""
    nsec: int = INFINITE_NS % 10**9
    """The rest [ns]."""

    @classmethod
    def of(cls, nanoseconds: int) -> Span:
        """Return the duration of a number of nanoseconds."""
        return cls(*divmod(nanoseconds, 10**9))

    @property
    def nanoseconds(self) -> int:
        """Nanoseconds, INFINITE_NS at most; old encodings of infinity give INFINITE_NS."""
        if (self.sec, self.nsec) in _OLD_INFINITE:
            return INFINITE_NS
        return min(self.sec * 10**9 + self.nsec, INFINITE_NS)


@dataclass(frozen=True, slots=True)
class Qos:
    """Quality of service that one publisher offered; policy names as rmw spells them."""

    history: str = "keep_last"
    """Which messages are kept, `keep_last` or `keep_all`."""
    depth: int = 10
    """How many messages are kept."""
    reliability: str = "reliable"
    """`reliable` or `best_effort`."""
    durability: str = "volatile"
    """`volatile`, or `transient_local` for late subscribers."""
    deadline: Span = Span()
    """Longest time between two messages."""
    lifespan: Span = Span()
    """Time after which a message is too old."""
    liveliness: str = "automatic"
    """Who says that the publisher lives."""
    liveliness_lease: Span = Span()
    """Time within which it must be said."""
    avoid_ros_namespace_conventions: bool = False
    """Whether the name on the wire lacks the prefix of ROS."""

    def as_map(self) -> dict[str, Any]:
        """Return the mapping that metadata version 9 holds."""
        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": _map(self.deadline),
            "lifespan": _map(self.lifespan),
            "liveliness": self.liveliness,
            "liveliness_lease_duration": _map(self.liveliness_lease),
            "avoid_ros_namespace_conventions": self.avoid_ros_namespace_conventions,
        }


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a bag.

    Parameters
    ----------
    name, type : str
        ``/arm/state`` and ``sensor_msgs/msg/JointState``.
    definition : str
        Text of the message definition and of all referenced types, in the order of rosbag2.
    definition_encoding : str
        ``ros2msg``, ``ros2idl``, or "" without a definition.
    type_hash : str
        ``RIHS01_...``, or "" if unknown.
    qos : tuple of Qos
        One profile for each publisher.
    serialization_format : str
        ``cdr`` for everything that ROS 2 records by itself.
    """

    name: str
    type: str
    definition: str = ""
    definition_encoding: str = "ros2msg"
    type_hash: str = ""
    qos: tuple[Qos, ...] = ()
    serialization_format: str = "cdr"


def encoding(topic: Topic) -> str:
    """Return how the messages of a topic are written, in words; "" for those of ROS 2."""
    kind = topic.serialization_format
    if kind == "cdr":
        return ""
    return _ENCODINGS.get(kind, f"serialised as {kind!r:.40}" if kind else "of an unknown encoding")


def check_encoding(topic: Topic, bag: Path) -> None:
    """Raise BagError if the messages of a topic are not those of ROS 2, or not of one definition."""
    if topic.definition_encoding == SEVERAL:
        raise BagError(f"the bag has several definitions of {topic.type}", bag, "format", topic.name)
    if what := encoding(topic):
        raise BagError(f"messages are {what}; allowed: ROS 2 messages (cdr)", bag, "format", topic.name)


def load_yaml(text: str) -> Any:
    """Parse YAML with libyaml if PyYAML has it (ten times faster).

    Raises
    ------
    yaml.YAMLError
        If the text is not YAML, or holds what recorders never write and what can exhaust a reader: megabytes,
        references, many levels (which would end the process), invalid numbers and dates.
    """
    if len(text) > _MOST_TEXT:
        raise yaml.YAMLError(f"more than {_MOST_TEXT} characters")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    depth = 0
    for event in yaml.parse(text, Loader=loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if isinstance(event, yaml.AliasEvent) or depth > _MAX_DEPTH:
            raise yaml.YAMLError(f"references, or more than {_MAX_DEPTH} levels")
    try:
        return yaml.load(text, Loader=loader)
    except (ValueError, OverflowError) as error:
        raise yaml.YAMLError(str(error)) from None


def qos_to_yaml(profiles: Sequence[Qos]) -> str:
    """Return the YAML text of the channel metadata key ``offered_qos_profiles``."""
    text: str = yaml.safe_dump([qos.as_map() for qos in profiles], sort_keys=False)
    return text.strip()


def qos_from(value: object, file: str = "") -> tuple[Qos, ...]:
    """Read profiles of any metadata version: YAML text or a list, policies by number or by name.

    `file` is where the value stands, for errors.

    Raises
    ------
    BagError
        If the value is not a list of profiles.
    """
    if isinstance(value, str):
        try:
            value = load_yaml(value)
        except yaml.YAMLError:
            raise BagError("no valid YAML", file, "value", _QOS_KEY) from None
    if value is None or value == "":
        return ()
    if not isinstance(value, list) or not all(isinstance(item, Mapping) for item in value):
        raise BagError(f"got {value!r:.60}; allowed: a list of profiles", file, "value", _QOS_KEY)
    return tuple(_profile(item, file) for item in value)


def _profile(item: Mapping[str, Any], file: str) -> Qos:
    try:
        return Qos(
            history=_policy("history", item),
            depth=int(item.get("depth", 0)),
            reliability=_policy("reliability", item),
            durability=_policy("durability", item),
            deadline=_span(item.get("deadline")),
            lifespan=_span(item.get("lifespan")),
            liveliness=_policy("liveliness", item),
            liveliness_lease=_span(item.get("liveliness_lease_duration")),
            avoid_ros_namespace_conventions=bool(item.get("avoid_ros_namespace_conventions", False)),
        )
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError) as error:
        raise BagError(f"{error} in {dict(item)!r:.80}", file, "value", _QOS_KEY) from None


def _policy(name: str, item: Mapping[str, Any]) -> str:
    value = item.get(name, "unknown")
    names = _POLICIES[name]
    if isinstance(value, int):
        return names[value] if 0 <= value < len(names) else "unknown"
    text = str(value).lower()
    return text if text in names else "unknown"


def _map(span: Span) -> dict[str, int]:
    return {"sec": span.sec, "nsec": span.nsec}


def _span(value: Mapping[str, int] | None) -> Span:
    return Span() if value is None else Span(int(value["sec"]), int(value["nsec"]))
