"""The recorder node: it writes all topics, or chosen ones, to a rosbag2 MCAP bag."""

from __future__ import annotations

import os
from datetime import datetime
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from soro_core.errors import ConfigError, SoroError
from soro_lab.bag import BackgroundWriter, BagWriter, Qos, Topic
from soro_lab.bag.config import RecorderConfig
from soro_ros.conversion import messages
from soro_ros.conversion.interfaces import definition, message_class, offered, request, topic_pattern
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_node
from soro_ros.recorder.recorder_controls import RecorderControls
from soro_ros.recorder.recorder_stream import RecordedTopic, essence
from soro_ros.topics.diagnostics import ERROR, OK, WARN

# Largest number of messages of a topic that are read at the end (Fast DDS keeps 5000 by default).
REST = 5000
CLOCK = "/clock"
# Longest step back of a clock that is corrected [ns].
SET_BACK_NS = 1_000_000_000
# Known offer of a later publisher: renewing a subscription would lose or repeat messages.
LATCHED = Qos(reliability="reliable", durability="transient_local")


class Recorder(SoroNode[RecorderConfig]):
    """Subscribes raw, with the offered quality of service, and records the ROS time of reception.

    With simulated time it records from the first time on: what came before has no time. In lockstep, whose
    /clock begins at 0, that is the time 0, and each time is that of the last message on /clock.
    """

    config_model = RecorderConfig
    node_name = "recorder"
    is_observer = True
    hardware = "folder"
    _bag: BackgroundWriter | None = None

    def setup(self, config: RecorderConfig) -> None:
        self._config, self._lockstep = config, config.mode == "lockstep"
        self._notes = dict(_split_note(note) for note in config.notes)
        wanted = [_split_topic(entry) for entry in config.topics]
        self._wanted = {
            topic_pattern(self, name, "topics"): (type_name, latched) for name, type_name, latched in wanted
        }
        self._excluded = tuple(topic_pattern(self, name, "exclude") for name in config.exclude)
        # In lockstep /clock gives the times, recorded or not.
        self._only_heard = {CLOCK} if self._lockstep and not self._is_wanted(CLOCK) else set[str]()
        self._controls = RecorderControls(self, self._write_missed)

    def start(self) -> None:
        self._last_ns = self._clock_ns = 0
        self._streams: dict[str, RecordedTopic] = {}
        self._refused: set[str] = set()
        folder = Path(self._config.folder or f"bag-{datetime.now():%Y%m%d-%H%M%S}").expanduser()
        self.diagnostics.hardware_id = folder.name
        writer = BagWriter(
            folder,
            self._config.compression,
            ros_distro=os.environ.get("ROS_DISTRO", "jazzy"),
            custom_data=self._notes,
            split_bytes=self._config.split_bytes,
            split_ns=round(self._config.split_s * 1e9),
        )
        self._bag = BackgroundWriter(writer, self._config.flush_s, self._config.buffer_bytes)
        self._folder = folder
        self._controls.begin(self._bag, self._config.paused)
        for name, (type_name, latched) in self._wanted.items():
            if type_name and self._is_wanted(name):
                self._subscribe(name, type_name, (LATCHED,) if latched else ())
        for name in self._only_heard:
            self._subscribe(name, "rosgraph_msgs/msg/Clock", ())
        self._discover()
        self.every(self._config.discovery_s, self._discover)
        later = ", paused" if self._controls.paused else ""
        later += "" if self.clock_watch.has_time else ", from the first time on /clock on"
        self.get_logger().info(f"recording in {folder}{later}")

    def stop(self) -> None:
        self._take_the_rest()
        for stream in self._streams.values():
            self.destroy_subscription(stream.subscription)
        self._close()
        self._streams.clear()

    def make_safe(self) -> None:
        try:
            try:
                self._take_the_rest()
            finally:  # after an error of the subscriptions too, so that the bag stays readable
                self._close()
        except Exception as error:
            self.failure = error if isinstance(error, SoroError) else SoroError(repr(error))
            self.get_logger().error(str(error))

    def diagnose(self) -> None:
        bag = self._bag
        if bag is None:
            return
        values = {
            "folder": self._folder,
            "topics": len(self._streams.keys() - self._only_heard),
            "messages": bag.message_count,
            "bytes": bag.byte_count,
            "waiting_bytes": bag.waiting_bytes,
            "dropped": bag.dropped,
            "lost": self._lost,
        }
        if bag.failure is not None:
            if self.failure is None:
                self.get_logger().error(f"{bag.failure}; {bag.dropped} messages are not in the bag")
            self.failure = bag.failure
            self.diagnostics.update(ERROR, str(bag.failure), values)
        elif bag.dropped or self._lost:
            self.diagnostics.update(WARN, "messages were lost", values)
        elif not self.clock_watch.has_time:
            self.diagnostics.update(OK, "waiting for /clock", values)
        else:
            self.diagnostics.update(OK, "paused" if self._controls.paused else "recording", values)

    def _close(self) -> None:
        bag = self._bag
        if bag is None:
            return
        self._bag = None
        self._controls.end()
        bag.close()
        lost = f", {bag.dropped} lost" if bag.dropped else ""
        lost += "".join(f", {name}: {count} lost on the way" for name, count in self._losses().items())
        self.get_logger().info(
            f"recorded {bag.message_count} messages, {bag.byte_count} bytes in {self._folder}{lost}"
        )

    @property
    def _lost(self) -> int:
        return sum(self._losses().values())

    def _losses(self) -> dict[str, int]:
        """Messages that were lost on the way, by topic."""
        return {name: one.loss.lost for name, one in self._streams.items() if one.loss.lost}

    # Topics --------------------------------------------------------------------------------------
    def _discover(self) -> None:
        """Subscribe to new topics; renew a subscription that no longer matches all publishers."""
        for name, types in self.get_topic_names_and_types():
            if not (self._is_wanted(name) or name in self._only_heard):
                continue
            endpoints = self.get_publishers_info_by_topic(name)
            if not endpoints:
                continue
            if len(types) > 1 and name not in self._streams:
                self._refuse(name, f"several types: {', '.join(types)}")
                continue
            publishers = frozenset(bytes(endpoint.endpoint_gid) for endpoint in endpoints)
            stream = self._streams.get(name)
            if stream is not None and stream.known_to_bag and stream.loss.publishers == publishers:
                continue  # the offer of a publisher stays
            offers = offered(endpoints)
            if stream is None:
                self._subscribe(name, types[0], offers)
            elif stream.qos != essence(request(offers)):
                self.destroy_subscription(stream.subscription)
                stream.subscription, stream.qos = self._subscription(name, stream.kind, offers)
            self._introduce(name, endpoints)
            if (stream := self._streams.get(name)) is not None:
                stream.loss.is_from(publishers)

    def _is_wanted(self, name: str) -> bool:
        if any(fnmatchcase(name, pattern) for pattern in self._excluded):
            return False
        if name in self._wanted:
            return True
        if any(token.startswith("_") for token in name.split("/")):
            return False  # a hidden topic needs its full name
        return not self._wanted or any(fnmatchcase(name, pattern) for pattern in self._wanted)

    def _subscribe(self, name: str, type_name: str, offers: tuple[Qos, ...]) -> None:
        kind = message_class(type_name)
        if kind is None:
            self._refuse(name, f"type {type_name} is not installed")
            return
        if not self.clock_watch.has_time and request(offers).durability is DurabilityPolicy.TRANSIENT_LOCAL:
            return  # `_discover` subscribes when there is time, and its publishers send their messages again
        subscription, qos = self._subscription(name, kind, offers)
        self._streams[name] = RecordedTopic(type_name, kind, subscription, qos)

    def _subscription(
        self, name: str, kind: type[Any], offers: tuple[Qos, ...]
    ) -> tuple[Subscription, tuple[object, object]]:
        profile = request(offers)
        # Without the callback for lost messages: taking that event deadlocks with the thread of Fast DDS
        # that reports it (reader's lock against event's lock), and the recorder would never end.
        subscription = self.create_subscription(
            kind, name, lambda data: self._on_message(name, data), profile, raw=True
        )
        return subscription, essence(profile)

    def _refuse(self, name: str, reason: str) -> None:
        if name not in self._refused:
            self._refused.add(name)
            self.get_logger().warning(f"{name}: not recorded: {reason}")

    def _introduce(self, name: str, endpoints: Any) -> None:
        """Write a topic with the offers of its publishers to the bag, before its first message."""
        stream = self._streams.get(name)
        if stream is None or stream.known_to_bag or self._bag is None or name in self._only_heard:
            return
        stream.known_to_bag = True
        about = definition(stream.type_name)
        # A type without files here may still carry its hash in the graph.
        type_hash = about.type_hash or next((str(endpoint.topic_type_hash) for endpoint in endpoints), "")
        self._bag.add_topic(
            Topic(name, stream.type_name, about.text, about.encoding, type_hash, offered(endpoints))
        )

    # Messages ------------------------------------------------------------------------------------
    def _on_message(self, name: str, data: bytes) -> None:
        self._take(name, data)
        if self._bag is not None and self._streams[name].loss.wants_sample:
            self._take_one(name)

    def _take_one(self, name: str) -> bool:
        """Record a message that has arrived but is not yet processed; return whether there was one."""
        stream = self._streams[name]
        with stream.subscription.handle:
            taken = stream.subscription.handle.take_message(stream.kind, True)
        if taken is not None:
            self._take(name, taken[0], taken[1]["publication_sequence_number"])
        return taken is not None

    def _take(self, name: str, data: bytes, number: int | None = None) -> None:
        if self._bag is None:
            return
        stream = self._streams[name]
        stream.loss.receive(number)
        if self._lockstep and name == CLOCK:
            self._clock_ns = messages.to_ns(deserialize_message(data, stream.kind).clock)
        if name in self._only_heard:
            return
        now_ns = self._now_ns()
        has_time = self._lockstep or now_ns > 0
        if self._controls.paused and stream.latched and has_time:
            stream.missed = data
        if self._controls.paused or not has_time:
            return
        self._write(name, data, now_ns)

    def _now_ns(self) -> int:
        return self._clock_ns if self._lockstep else int(self.get_clock().now().nanoseconds)

    def _write(self, name: str, data: bytes, now_ns: int) -> None:
        bag = self._bag
        if bag is None:
            return
        if not self._streams[name].known_to_bag:
            self._introduce(name, self.get_publishers_info_by_topic(name))
        # Times that never run backwards keep the order of arrival when the bag is read by time; but after a
        # clock has been set back, as after one wrong time on /clock, they would all be the same.
        if (back_ns := self._last_ns - now_ns) > SET_BACK_NS:
            self.get_logger().warning(f"the clock went back by {back_ns * 1e-9:.3f} s: the recording too")
            self._last_ns = now_ns
        self._last_ns = max(self._last_ns, now_ns)
        bag.write(name, data, self._last_ns)

    def _write_missed(self) -> None:
        for name, stream in self._streams.items():
            missed, stream.missed = stream.missed, None
            if missed is not None:
                self._write(name, missed, self._now_ns())

    def _take_the_rest(self) -> None:
        """Record messages that have arrived but are not yet processed; their senders count on them."""
        if self._bag is None:
            return
        for name in self._streams:
            for _ in range(REST):
                if not self._take_one(name):
                    break


def _split_note(note: str) -> tuple[str, str]:
    key, equals, value = note.partition("=")
    if not (key and equals):
        raise ConfigError("parameters of recorder", "notes", note, "key=value")
    return key, value


def _split_topic(entry: str) -> tuple[str, str, bool]:
    name, *rest = entry.split() or [""]
    if len(rest) > 2 or rest[1:] not in ([], ["transient_local"]):
        raise ConfigError(
            "parameters of recorder", "topics", entry, "NAME, 'NAME TYPE' or 'NAME TYPE transient_local'"
        )
    return name, rest[0] if rest else "", len(rest) > 1


def main() -> None:
    """Run the recorder as a process."""
    run_node(Recorder)


if __name__ == "__main__":
    main()
