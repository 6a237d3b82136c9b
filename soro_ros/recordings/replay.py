"""A recorded run through the same code as in the nodes, compared with what they published.

No process and no node is started. Each of the two is fed with what was recorded on its own inputs, so that
a difference of the estimator does not become one of the controller.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from soro_core.config import with_changes
from soro_core.errors import BagError, ConfigError
from soro_lab.bag import BagReader, Topic
from soro_lab.scene import Scene, with_robot_files
from soro_ros.conversion.decoding import Messages, class_of
from soro_ros.conversion.fields import flat
from soro_ros.conversion.interfaces import type_name
from soro_ros.recordings.differences import TopicDifferences, stamp_of
from soro_ros.ticks.controller_ticks import ControllerTicks
from soro_ros.ticks.estimator_ticks import EstimatorTicks
from soro_ros.topics.ports import Inputs, NodeOutputs

# Above the difference that other processors make, whose linear algebra rounds otherwise (docs/bags.md).
TOLERANCE = 1e-5


# The topic on which a node learns what became of its own output.
ANSWER = "arm/learned"


class Ticks(Protocol):
    """The work of a node between its messages."""

    inputs: Inputs


def _estimator(arm: Scene, in_hand: bool, ports: NodeOutputs) -> Ticks:
    return EstimatorTicks(arm.estimator_node(), ports)


def _controller(arm: Scene, in_hand: bool, ports: NodeOutputs) -> Ticks:
    # `soro run` enables it before the first tick; no bag holds the call of a service.
    config = with_changes(arm.controller_node(), enabled=True, hand=in_hand)
    return ControllerTicks(config, f"/{arm.name}/controller", ports)


NODES: dict[str, tuple[type[Any], Callable[[Scene, bool, NodeOutputs], Ticks]]] = {
    "estimator": (EstimatorTicks, _estimator),
    "controller": (ControllerTicks, _controller),
}


@dataclass(frozen=True)
class Replayed:
    """What a replay found.

    Attributes
    ----------
    topics : tuple of TopicDifferences
        Every compared topic.
    left_out : tuple of str
        Outputs that the bag does not hold.
    without : tuple of str
        Inputs of the loop that it does not hold: a tick that waits for one is not computed.
    problems : tuple of str
        What is damaged in the bag, or cannot be read and is left out.
    """

    topics: tuple[TopicDifferences, ...]
    left_out: tuple[str, ...]
    without: tuple[str, ...]
    problems: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether nothing differs."""
        return not any(topic.differing for topic in self.topics)


def replay(
    bag: Path,
    scene: Scene,
    nodes: Sequence[str] = tuple(NODES),
    tolerance: float = TOLERANCE,
    ignore: Sequence[str] = (),
) -> Replayed:
    """Replay nodes of a run in lockstep, those of each of its arms.

    Parameters
    ----------
    bag : Path
        Recording of the run.
    scene : Scene
        Of all arms.
    nodes : sequence of str
        Names in `NODES`.
    tolerance : float
        Allowed difference of a number, a part of its largest recorded magnitude; 0: equal to the bit.
    ignore : sequence of str
        Topics, or fields as ``arm/tip.pose.covariance``, or patterns of them.

    Raises
    ------
    ConfigError
        If a node is unknown, or the run was not in lockstep.
    BagError
        If the bag cannot be read, or lacks the inputs.
    """
    if not nodes or not NODES.keys() >= set(nodes):
        raise ConfigError("soro replay", "--nodes", ",".join(nodes), f"of {', '.join(NODES)}")
    if not 0.0 <= tolerance < math.inf:
        raise ConfigError("soro replay", "--tolerance", tolerance, "a finite number, 0 or more")
    if scene.mode != "lockstep":
        allowed = "lockstep: in real time no recording says what a node had received at a tick"
        raise ConfigError(scene.name, "mode", scene.mode, allowed)
    with TemporaryDirectory() as folder:
        arms = with_robot_files(scene, Path(folder)).each
        fingers = {finger.name for finger in scene.fingers}
        each = [_replay_arm(bag, arm, arm.name in fingers, nodes, tolerance, ignore) for arm in arms]
    return Replayed(
        tuple(topic for one in each for topic in one.topics),
        tuple(name for one in each for name in one.left_out),
        tuple(name for one in each for name in one.without),
        tuple(dict.fromkeys(problem for one in each for problem in one.problems)),
    )


def _replay_arm(
    bag: Path, arm: Scene, in_hand: bool, nodes: Sequence[str], tolerance: float, ignore: Sequence[str]
) -> Replayed:
    """Replay nodes of one arm; `in_hand`: a hand moves it."""
    prefix = f"/{arm.name}/"
    outputs = {prefix + topic: kind for name in nodes for topic, kind in NODES[name][0].outputs.items()}
    with BagReader(bag) as reader:
        there = {topic.name: _type_now(topic) for topic in reader.topics}
        compared = {topic: kind for topic, kind in outputs.items() if topic in there}
        if not any(reader.count(topic) for topic in compared):
            raise BagError(f"no message of {', '.join(sorted(outputs))}", bag, "missing")
        largest = _largest(Messages(reader, compared))
        found = {
            topic: TopicDifferences(topic, largest[topic], tolerance, _Ignored(topic, prefix, ignore))
            for topic in compared
        }

        fed = [_Fed(name, arm, in_hand, found) for name in nodes]
        kinds = compared | {topic: one.kind for node in fed for topic, one in node.inputs.items()}
        _check(bag, there, kinds, prefix, fed)
        recorded = Messages(reader, kinds)
        recorded.need(kinds)
        for item, message in recorded():
            if item.topic in found:
                found[item.topic].take_recorded(message)
            for node in fed:
                node.take(item.topic, message)
        problems = tuple(recorded.problems)
    for one in found.values():
        one.finish()
    inputs = {
        topic for node in fed for topic in node.inputs if not topic.startswith(f"{prefix}arm/reference/")
    }
    left_out, without = (tuple(sorted(topics - there.keys())) for topics in (outputs.keys(), inputs))
    return Replayed(tuple(found.values()), left_out, without, problems)


class _Fed:
    """A node that is replayed.

    A recorder notes topics in an order of its own. In lockstep that does not matter, because a tick waits for
    its inputs; only the answer to a tick, arm/learned, must not come before the tick.
    """

    def __init__(self, name: str, arm: Scene, in_hand: bool, found: Mapping[str, TopicDifferences]) -> None:
        self._prefix, self._found = (prefix := f"/{arm.name}/"), found
        self._reached_ns, self._early = -1, deque[Any]()
        ticks = NODES[name][1](arm, in_hand, NodeOutputs(self._publish))
        self.inputs = {
            topic if topic.startswith("/") else prefix + topic: one for topic, one in ticks.inputs.items()
        }

    def take(self, topic: str, message: Any) -> None:
        """Take a recorded message, if it is an input."""
        if topic not in self.inputs:
            return
        if topic == self._prefix + ANSWER:
            self._early.append(message)
        else:
            self.inputs[topic].take(message)
        while self._early and stamp_of(self._early[0]) <= self._reached_ns:
            self.inputs[self._prefix + ANSWER].take(self._early.popleft())

    def _publish(self, topic: str, message: Any) -> None:
        self._reached_ns = max(self._reached_ns, stamp_of(message))
        if (one := self._found.get(self._prefix + topic)) is not None:
            one.take_now(message)


def _type_now(topic: Topic) -> str:
    kind = class_of(topic)
    return topic.type if kind is None else type_name(kind)


def _check(
    bag: Path, there: Mapping[str, str], kinds: Mapping[str, type[Any]], prefix: str, fed: Sequence[_Fed]
) -> None:
    """Raise BagError if a topic has another type, or one that every tick needs is missing."""
    for topic, kind in kinds.items():
        if there.get(topic, type_name(kind)) != type_name(kind):
            raise BagError(f"{topic} is a {there[topic]}; allowed: {type_name(kind)}", bag, "value", topic)
    needed = {prefix + name for name in ("chambers/state", "arm/state")}
    if missing := sorted(needed & {topic for node in fed for topic in node.inputs} - there.keys()):
        raise BagError(f"no {', '.join(missing)}, which the nodes need", bag, "missing")


def _largest(messages: Messages) -> dict[str, dict[str, float]]:
    """Return the largest magnitude of every recorded number, by topic and field."""
    largest: dict[str, dict[str, float]] = defaultdict(dict)
    for item, message in messages():
        known = largest[item.topic]
        for field, value in flat(message).items():
            if isinstance(value, float) and math.isfinite(value):
                known[field] = max(known.get(field, 0.0), abs(value))
    return largest


class _Ignored:
    """Whether a field of a topic is ignored, or by an empty name the topic."""

    def __init__(self, topic: str, prefix: str, patterns: Sequence[str]) -> None:
        self._name = topic.removeprefix(prefix)
        self._patterns = [pattern.removeprefix(prefix) for pattern in patterns]

    def __call__(self, field: str) -> bool:
        path = f"{self._name}.{field}" if field else self._name
        return any(
            path == pattern or path.startswith(f"{pattern}.") or fnmatchcase(path, pattern)
            for pattern in self._patterns
        )
