"""The topics of a recorded run as arrays over time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array
from soro_ros.recordings.events import (
    Event,
    NodeStatus,
    Said,
    clock,
    contacts_of,
    events_of,
    statuses_of,
    under_control,
)
from soro_ros.status_words import STAGES, is_requested, node_of

if TYPE_CHECKING:  # a run without ROS is a recording too
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    from soro_core.adaptation.external_force import Stage
    from soro_lab.bag import BagMessage, BagReader

# Topics of an arm that the pictures show; an arm is a namespace with one of them.
SHOWN = ("chambers/state", "chambers/command", "arm/state", "arm/tip", "arm/desired/tip", "truth/tip")
_LATCH = "chambers/latch"
_AXIS = "truth/tip axis"
# Of a hinged body: angle of the encoder, rate, torque of its drive.
_JOINT = re.compile(r"/bodies/[^/]+/joint$")
_USED = {
    *SHOWN,
    _LATCH,
    "controller/estimates",
    "controller/deviations",
    "sensors/pose0",
    "arm/shadow/difference",
    "arm/shadow/tip",
    "truth/state",
    "truth/wrench",
    "arm/wrench",
    "arm/wrench/covariance",
    "arm/desired/wrench",
    "arm/configured/tip",
}


@dataclass(frozen=True)
class TopicSeries:
    """Samples of one topic: stamps `t` (n,) [s], values (n, m), and a name a column where there are names."""

    t: Array
    value: Array
    names: tuple[str, ...] = ()

    def at(self, t: Array) -> Array:
        """Values interpolated at other times, (len(t), m)."""
        columns = [np.interp(t, self.t, column) for column in self.value.T]
        return np.column_stack(columns) if columns else np.zeros((len(t), 0))

    def at_times(self, chosen: NDArray[np.bool_]) -> TopicSeries:
        """Return the chosen (n,) of its samples."""
        return TopicSeries(self.t[chosen], self.value[chosen], self.names)


# No arm has larger numbers [m, rad, Pa].
_MOST = 1e8
EMPTY = TopicSeries(np.zeros(0), np.zeros((0, 0)))


@dataclass(frozen=True)
class RunRecording:
    """The topics of a run for its report; times count from the first set point under control.

    Of a recording without set points they count from its first message.

    Tips are positions (n, 3) [m], pressures [Pa gauge]. Of a real arm there is no true tip, only the measured
    one; `configured_tip` is that on the configured circle, from when another elongation was chosen for it on.
    `shadow` has its differences from the twin beside it, whose tip is `shadow_tip`. States
    are the coordinates of the plant and those of the estimator. Forces (n, 3) [N] are those on the arm at its
    tip; `force_doubt` has the stage of contact and the covariance by name, `tip_axis` the direction of the
    backbone at the true tip. `joint` has the angle [rad] of a hinged body and the `effort` of its drive
    [N m]; of several, that with most messages. `said` has the changes of what the nodes say.
    `problems` are lines on what is damaged, or cannot be read and is left out.
    """

    true_tip: TopicSeries
    estimated_tip: TopicSeries
    wanted_tip: TopicSeries
    command: TopicSeries
    reading: TopicSeries
    estimates: TopicSeries
    diagnostics: dict[str, dict[str, str]]
    faults: tuple[str, ...]
    measured_tip: TopicSeries = EMPTY
    shadow: TopicSeries = EMPTY
    shadow_tip: TopicSeries = EMPTY
    deviations: TopicSeries = EMPTY
    true_state: TopicSeries = EMPTY
    estimated_state: TopicSeries = EMPTY
    true_force: TopicSeries = EMPTY
    estimated_force: TopicSeries = EMPTY
    wanted_force: TopicSeries = EMPTY
    configured_tip: TopicSeries = EMPTY
    force_doubt: TopicSeries = EMPTY
    tip_axis: TopicSeries = EMPTY
    joint: TopicSeries = EMPTY
    events: tuple[Event, ...] = ()
    said: tuple[NodeStatus, ...] = ()
    problems: tuple[str, ...] = ()


def read(bag: Path, namespace: str) -> RunRecording:
    """Read a run's bag, with the namespace of the robot's nodes."""
    from soro_lab.bag import BagReader

    with BagReader(bag) as reader:
        return recorded(reader, namespace)


@dataclass(frozen=True)
class Spans:
    """First and last log time of each topic, and the longest gap between two messages [ns]."""

    of: dict[str, tuple[int, int, int]] = field(default_factory=dict)

    def note(self, item: BagMessage) -> None:
        """Take the next message of the bag."""
        now = item.log_time_ns
        first, last, gap = self.of.get(item.topic, (now, now, 0))
        self.of[item.topic] = first, now, max(gap, now - last)


def with_fault(faults: tuple[str, ...], error: str) -> tuple[str, ...]:
    """Return the faults and another one; a text that goes on behind a semicolon replaces its beginning."""
    if any(f"{one};".startswith(f"{error};") for one in faults):
        return faults
    return (*(one for one in faults if not error.startswith(f"{one};")), error)


def recorded(reader: BagReader, namespace: str, spans: Spans | None = None) -> RunRecording:
    """Read an open bag.

    Parameters
    ----------
    reader : BagReader
    namespace : str
        Namespace of the robot's nodes.
    spans : Spans, optional
        Takes the times of every message, also of other topics.
    """
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
    from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, WrenchStamped
    from sensor_msgs.msg import JointState

    from soro_ros.conversion import force, messages
    from soro_ros.conversion.decoding import Messages

    types = {
        "sensor_msgs/msg/JointState": JointState,
        "geometry_msgs/msg/PoseStamped": PoseStamped,
        "geometry_msgs/msg/PoseWithCovarianceStamped": PoseWithCovarianceStamped,
        "geometry_msgs/msg/WrenchStamped": WrenchStamped,
        "diagnostic_msgs/msg/DiagnosticArray": DiagnosticArray,
        "diagnostic_msgs/msg/DiagnosticStatus": DiagnosticStatus,
    }
    prefix = f"/{namespace}/" if namespace else "/"
    of_scene = f"/{namespace.partition('/')[0]}/" if namespace else "/"  # several arms have bodies in common
    # Stamps, log times and values, by topic and names of their columns.
    rows: dict[str, dict[tuple[str, ...], list[tuple[int, int, list[float]]]]] = {}
    diagnostics: dict[str, dict[str, str]] = {}
    faults: tuple[str, ...] = ()
    said: list[Said] = []
    wanted = {
        topic.name
        for topic in reader.topics
        if topic.type in types
        and (
            topic.name == "/diagnostics"
            or topic.name in {prefix + name for name in _USED}
            or (topic.name.startswith(of_scene) and _JOINT.search(topic.name))
        )
    }
    kinds = {topic.name: types[topic.type] for topic in reader.topics if topic.name in wanted}
    messages_of = Messages(reader, kinds)
    for item in reader.messages(wanted if spans is None else None):
        if spans is not None:
            spans.note(item)
        if (message := messages_of.read(item)) is None:
            continue
        name = item.topic.removeprefix(prefix)
        if isinstance(message, DiagnosticArray):
            said += [Said(item.log_time_ns, *words) for words in _levels(message, prefix)]
            for node, found, error in statuses(message, prefix):
                diagnostics[node] = found
                faults = with_fault(faults, error) if error else faults
            continue
        if isinstance(message, DiagnosticStatus):
            if name == _LATCH:
                said.append(Said(item.log_time_ns, "latch", _level(message), message.message))
            continue
        if isinstance(message, JointState):
            values = list(message.effort if name.startswith("chambers") else message.position)
            names = tuple(message.name)
            if _JOINT.search(item.topic):  # an encoder tells no effort
                name, names = "joint", (*names, "effort")
                values = [*values, *(message.effort or [np.nan])]
            # What has no values has no column.
            if not values or len(values) != len(names):
                continue
        elif isinstance(message, WrenchStamped):
            names, values = (), force.force_of(message).tolist()
        else:
            names = ()
            pose = message.pose if isinstance(message, PoseStamped) else message.pose.pose
            values = [pose.position.x, pose.position.y, pose.position.z]
            if name == "truth/tip" and messages.is_pose(pose):
                axis = messages.transform(pose)[:3, 2].tolist()
                row = messages.to_ns(message.header.stamp), item.log_time_ns, axis
                rows.setdefault(_AXIS, {}).setdefault(names, []).append(row)
        if not any(abs(value) > _MOST for value in values):  # NaN is a chamber without a reading
            row = messages.to_ns(message.header.stamp), item.log_time_ns, values
            rows.setdefault(name, {}).setdefault(names, []).append(row)
    if not rows:
        messages_of.need(kinds)
    problems = tuple(messages_of.problems)
    # Other names are other columns, from another program: those of most messages count.
    kept = {name: max(groups.items(), key=lambda one: len(one[1])) for name, groups in rows.items()}
    if "arm/desired/tip" in kept:
        start = kept["arm/desired/tip"][1][0][0]
    else:
        start = min((listed[0][0] for _, listed in kept.values()), default=reader.start_ns)

    def series(name: str) -> TopicSeries:
        if name not in kept:
            return EMPTY
        names, listed = kept[name]
        t = np.array([stamp - start for stamp, _, _ in listed]) * 1e-9
        return TopicSeries(t, np.array([values for _, _, values in listed]), names)

    _, densest = max(kept.values(), key=lambda one: len(one[1]), default=((), []))
    stamps, logged = [row[0] for row in densest], [row[1] for row in densest]
    time_of = clock(logged, stamps, start)
    end_s = 1e-9 * (kept["arm/desired/tip"][1][-1][0] - start) if "arm/desired/tip" in kept else np.inf
    estimated, doubt = series("arm/wrench"), series("arm/wrench/covariance")
    events = tuple(sorted((*events_of(said, time_of), *_contacts(doubt, estimated))))
    return RunRecording(
        true_tip=series("truth/tip"),
        estimated_tip=series("arm/tip"),
        wanted_tip=series("arm/desired/tip"),
        command=series("chambers/command"),
        reading=series("chambers/state"),
        estimates=series("controller/estimates"),
        diagnostics=diagnostics,
        faults=faults,
        measured_tip=series("sensors/pose0"),
        deviations=series("controller/deviations"),
        shadow=series("arm/shadow/difference"),
        shadow_tip=series("arm/shadow/tip"),
        true_state=series("truth/state"),
        estimated_state=series("arm/state"),
        true_force=series("truth/wrench"),
        estimated_force=estimated,
        wanted_force=series("arm/desired/wrench"),
        configured_tip=series("arm/configured/tip"),
        force_doubt=doubt,
        joint=series("joint"),
        tip_axis=series(_AXIS),
        events=under_control(events, end_s),
        said=statuses_of(said, time_of),
        problems=problems,
    )


def has_stage(doubt: TopicSeries, stage: Stage) -> NDArray[np.bool_]:
    """Return at which samples (n,) of `RunRecording.force_doubt` the force has this stage."""
    if "stage" not in doubt.names:
        return np.zeros(doubt.t.size, dtype=bool)
    return np.asarray(doubt.value[:, doubt.names.index("stage")] == STAGES.index(stage))


def _contacts(doubt: TopicSeries, estimated: TopicSeries) -> tuple[Event, ...]:
    if not (doubt.t.size and estimated.t.size):
        return ()
    return contacts_of(doubt.t, has_stage(doubt, "contact"), np.linalg.norm(estimated.at(doubt.t), axis=1))


def arms(reader: BagReader) -> tuple[str, ...]:
    """Return the namespaces in a bag that have topics of an arm; ``""`` for none before them.

    Raises
    ------
    BagError
        If it cannot be read, or its messages are not those of ROS 2.
    """
    reader.check_encodings()
    found = [
        topic.name[: -len(shown) - 1].strip("/")
        for topic, count in zip(reader.topics, reader.counts, strict=True)
        for shown in SHOWN
        if count and topic.name.endswith(f"/{shown}")
    ]
    return tuple(sorted(set(found)))


def statuses(message: DiagnosticArray, prefix: str) -> Iterator[tuple[str, dict[str, str], str]]:
    """Yield the status of each node of the arm /prefix/; other arms publish on the same topic.

    Yields
    ------
    name : str
        Name of the node.
    values : dict of str to str
        Its diagnostic values.
    error : str
        Name and message of a node with an error, which a vent on request is not; "" of others.
    """
    for status in message.status:
        if (name := node_of(status.name, prefix)) is not None:
            is_error = _level(status) >= 2
            values = {pair.key: pair.value for pair in status.values}
            is_fault = is_error and not is_requested(status.message)
            yield name, values, f"{name}: {status.message}" if is_fault else ""


def _levels(message: DiagnosticArray, prefix: str) -> Iterator[tuple[str, int, str]]:
    for status in message.status:
        if (name := node_of(status.name, prefix)) is not None:
            yield name, _level(status), status.message


def _level(status: DiagnosticStatus) -> int:
    return int.from_bytes(status.level, "little")
