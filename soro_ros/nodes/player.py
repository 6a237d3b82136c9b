"""The player node: it publishes a bag again, byte for byte, in recorded time or as fast as possible.

Messages of a type that was defined otherwise when it was recorded are converted field by field, or left out.

Services, parameters and keys pause it, seek and change its rate.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from fnmatch import fnmatchcase

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.publisher import Publisher
from rclpy.time import Time
from rclpy.validate_topic_name import validate_topic_name
from rosgraph_msgs.msg import Clock

from soro_core.errors import BagError, ConfigError
from soro_lab.bag import BagMessage, BagReader, Topic
from soro_lab.bag.config import PlayerConfig
from soro_lab.bag.topics import check_encoding
from soro_ros.conversion import messages, qos
from soro_ros.conversion.decoding import class_of, playing
from soro_ros.conversion.interfaces import offer, topic_pattern
from soro_ros.host.claims import Claims, readings, require_free
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_node
from soro_ros.recorder.playback import Playback
from soro_ros.recorder.player_controls import PlayerControls
from soro_ros.topics.diagnostics import ERROR, OK, WARN

# History of a publisher whose recorded one is unknown (most middlewares do not report it).
DEPTH = 1000
# Longest wait for readers to confirm the last messages [s].
ACKNOWLEDGE_S = 10.0
_POLL_S = 0.02
# Topics with these endings drive valves; a bag must not do so by accident.
COMMANDS = ("/chambers/command", "/chambers/commands")
# Topics that the nodes of an arm publish, and by which it moves.
_OF_AN_ARM = re.compile(r"(.*)/(?:chambers/state|sensors/[^/]+|arm/(?!reference/).+)")


class Player(SoroNode[PlayerConfig]):
    """Plays a bag in a separate thread; the process ends with the bag."""

    config_model = PlayerConfig
    node_name = "player"
    is_observer = True
    hardware = "bag"
    live = ("rate", "loop", "start_s")

    def __init__(self) -> None:
        self._opened = ExitStack()  # by `setup`
        self._started = ExitStack()  # by `start`
        super().__init__()

    def setup(self, config: PlayerConfig) -> None:
        if not config.bag:
            raise ConfigError(
                "parameters of player", "bag", config.bag, "the folder of a bag, or an .mcap file"
            )
        self._config = config
        self._published: dict[str, Publisher] = {}
        self._played: dict[str, Callable[[bytes], bytes]] = {}
        self._left_out: dict[str, int] = {}
        self._clock_out: Publisher | None = None
        self._count = 0
        self._phase = "ready"
        with ExitStack() as opened:
            self._reader = opened.enter_context(BagReader(config.bag))
            self._begin_ns, self._end_ns = _span(self._reader, config)
            claims = Claims()
            opened.callback(claims.close)
            opened.callback(self._destroy_publishers)
            self._create_publishers()
            self._claim(claims)
            self._playback = self._new_playback()
            self._controls = PlayerControls(self, self._playback, config.start_s)
            opened.callback(self._controls.close)
            self._opened = opened.pop_all()
        self._said = set(self._reader.problems)
        for problem in self._reader.problems:
            self.get_logger().warning(f"{config.bag}: {problem}")

    def _new_playback(self) -> Playback[BagMessage | None]:
        config = self._config
        return Playback(self._events, self._begin_ns, self._end_ns, config.rate, config.loop)

    def start(self) -> None:
        playback = self._controls.playback = self._playback = self._new_playback()
        if self._config.paused:
            playback.pause()
        thread = threading.Thread(target=self._run, name="player", daemon=True)
        thread.start()
        self._started.callback(thread.join)
        self._started.callback(playback.stop)
        if self._config.keyboard:
            self._started.callback(self._controls.leave_terminal)
            self._controls.listen()

    def take(self, config: PlayerConfig) -> None:
        """Refuse a position outside of what is played; `PlayerControls` takes over the rest."""
        self._controls.check(config.start_s)

    def stop(self) -> None:
        self.make_safe()

    def teardown(self) -> None:
        self.make_safe()
        self._opened.close()

    def make_safe(self) -> None:
        self._started.close()

    def diagnose(self) -> None:
        if self._phase == "ready":
            return
        values = {
            "bag": self._config.bag,
            "position_s": self._config.start_s + self._playback.position_s,
            "rate": self._playback.rate,
            "paused": self._playback.paused,
            "duration_s": (self._reader.end_ns - self._reader.start_ns) / 1e9,
            "messages": self._count,
        }
        level = ERROR if self.failure else WARN if self._reader.problems else OK
        self.diagnostics.update(level, str(self.failure) if self.failure else self._phase, values)

    # Topics --------------------------------------------------------------------------------------
    def _create_publishers(self) -> None:
        config = self._config
        renamed = dict(self._split_remap(rule) for rule in config.remap)
        self._wanted = tuple(topic_pattern(self, name, "topics") for name in config.topics)
        self._excluded = tuple(topic_pattern(self, name, "exclude") for name in config.exclude)
        names = sorted({topic.name for topic in self._reader.topics})
        for pattern in self._wanted:
            if not any(fnmatchcase(name, pattern) for name in names):
                raise ConfigError("parameters of player", "topics", pattern, f"of {', '.join(names)}")
        wanted = [topic for topic in self._reader.topics if self._is_wanted(topic.name)]
        commands = [] if self._wanted else [topic for topic in wanted if topic.name.endswith(COMMANDS)]
        if commands:
            kept_back = ", ".join(sorted({topic.name for topic in commands}))
            self.get_logger().warning(
                f"left out: {kept_back} (would drive valves; played when named in topics)"
            )
        for topic in wanted:
            played = None if topic in commands else self._player_of(topic)
            if played is None:
                continue
            if topic.name in self._published:
                raise BagError(f"{config.bag}: topic {topic.name} has several types; exclude it")
            profile = offer(topic.qos, DEPTH, keep_all=config.rate == 0)
            name = renamed.get(topic.name, topic.name)
            self._played[topic.name] = played
            self._published[topic.name] = self.create_publisher(class_of(topic), name, profile)
        if not self._published:
            known = ", ".join(f"{topic.name} ({topic.type})" for topic in self._reader.topics) or "nothing"
            raise BagError(f"{config.bag}: no topic to play; the bag holds {known}")
        if config.clock:
            if min(self._end_ns, self._reader.end_ns) >= messages.END_NS:
                allowed = "false: the bag goes on after the last time of a message, in 2038"
                raise ConfigError("parameters of player", "clock", True, allowed)
            self._clock_out = self.create_publisher(Clock, "/clock", qos.RELIABLE)

    def _destroy_publishers(self) -> None:
        for publisher in (*self._published.values(), *([self._clock_out] if self._clock_out else [])):
            self.destroy_publisher(publisher)
        self._published.clear()
        self._clock_out = None

    def _claim(self, claims: Claims) -> None:
        """Claim the readings and the time that are played; refuse to mix with those of a running arm."""
        names = {publisher.topic_name for publisher in self._published.values()}
        names |= {self._clock_out.topic_name} if self._clock_out else set()
        arms = {readings(found[1]) for name in names if (found := _OF_AN_ARM.fullmatch(name))}
        own = names & {*arms, "/clock"}
        claims.take(self, sorted(own))
        require_free(self, sorted(arms - own))

    def _is_wanted(self, name: str) -> bool:
        if self._config.clock and name == "/clock":
            return False
        if any(fnmatchcase(name, pattern) for pattern in self._excluded):
            return False
        return not self._wanted or any(fnmatchcase(name, pattern) for pattern in self._wanted)

    def _split_remap(self, rule: str) -> tuple[str, str]:
        old, sign, new = rule.partition(":=")
        if not (sign and old and new):
            raise ConfigError("parameters of player", "remap", rule, "OLD:=NEW")
        return topic_pattern(self, old, "remap"), topic_pattern(self, new, "remap")

    def _player_of(self, topic: Topic) -> Callable[[bytes], bytes] | None:
        """Return what makes the bytes to publish of recorded ones; None if the topic cannot be played."""
        kind = class_of(topic)
        if not _is_name(topic.name):
            self.get_logger().warning(f"{topic.name!r}: not played: no name of a topic")
            return None
        try:
            if kind is not None:
                return playing(topic, kind, self._reader.path)
            check_encoding(topic, self._reader.path)
            reason = f"type {topic.type} is not installed"
        except BagError as error:
            reason = error.text
        self.get_logger().warning(f"{topic.name}: not played: {reason}")
        return None

    # Playing -------------------------------------------------------------------------------------
    def _run(self) -> None:
        try:
            self._phase = "waiting for readers"
            if self._config.wait_for_subscribers:
                self._wait_for_subscribers()
            self._phase = "playing"
            names = ", ".join(sorted(publisher.topic_name for publisher in self._published.values()))
            self.get_logger().info(f"playing {self._config.bag}: {names}")
            self._playback.run(self._emit)
            if not self._playback.stopped:
                self._await_acknowledgement()
                for name, count in self._left_out.items():
                    self.get_logger().warning(f"left out: {name}: {count} messages, which cannot be read")
                for problem in set(self._reader.problems) - self._said:
                    self.get_logger().warning(f"{self._config.bag}: {problem}")
                self.get_logger().info(f"played {self._count} messages")
        except Exception as error:
            self.note_failure(error)  # it ends only this thread; the process is to end as well
        finally:
            self._phase = "finished"
            self.finish()

    def _wait_for_subscribers(self) -> None:
        limit = time.monotonic() + self._config.wait_timeout_s
        while not self._playback.stopped:
            lonely = [pub.topic_name for pub in self._published.values() if not pub.get_subscription_count()]
            if not lonely:
                return
            if time.monotonic() > limit:
                raise BagError(
                    f"no subscriber of {', '.join(lonely)} within {self._config.wait_timeout_s:g} s"
                )
            self._playback.wait(_POLL_S)

    def _emit(self, stamp_ns: int, message: BagMessage | None) -> None:
        if message is None:
            if self._clock_out is not None:
                self._clock_out.publish(Clock(clock=Time(nanoseconds=stamp_ns).to_msg()))
            return
        try:
            data = self._played[message.topic](message.data)
        except BagError as error:
            if message.topic not in self._left_out:
                self.get_logger().warning(f"left out: {error}")
            self._left_out[message.topic] = self._left_out.get(message.topic, 0) + 1
            return
        self._send(self._published[message.topic], data)
        self._count += 1

    def _events(self, begin_ns: int) -> Iterator[tuple[int, BagMessage | None]]:
        """Yield messages by time, and None for a tick of /clock, before the messages of that tick."""
        tick_ns = round(1e9 / self._config.clock_hz)
        next_tick = begin_ns
        for message in self._reader.messages(self._published.keys(), begin_ns, self._end_ns):
            while self._clock_out is not None and next_tick <= message.log_time_ns:
                yield next_tick, None
                next_tick += tick_ns
            yield message.log_time_ns, message

    def _send(self, publisher: Publisher, data: bytes) -> None:
        """Publish; if the history is full (rate 0), try again until readers have received enough."""
        while not self._playback.stopped:
            try:
                publisher.publish(data)
            except RuntimeError:
                if self._playback.rate > 0:
                    raise
                self._playback.wait(_POLL_S)
            else:
                return

    def _await_acknowledgement(self) -> None:
        """Wait until readers confirm the last messages: the history ends with its publisher."""
        limit = time.monotonic() + ACKNOWLEDGE_S
        for publisher in self._published.values():
            # Short waits, so that Ctrl-C takes effect.
            while not publisher.wait_for_all_acked(Duration(seconds=_POLL_S)):
                if self._playback.stopped:
                    return
                if time.monotonic() > limit:
                    self.get_logger().warning(
                        f"{publisher.topic_name}: a reader did not confirm the last messages"
                    )
                    break


def _is_name(name: str) -> bool:
    try:
        validate_topic_name(name)
    except InvalidTopicNameException:
        return False
    return True


def _span(reader: BagReader, config: PlayerConfig) -> tuple[int, int]:
    """Return the log times [ns] of begin and end of the replay."""
    begin = reader.start_ns + round(config.start_s * 1e9)
    if reader.message_count == 0 or begin > reader.end_ns:
        length = (reader.end_ns - reader.start_ns) / 1e9
        raise BagError(f"{config.bag}: nothing to play: {reader.message_count} messages in {length:g} s")
    end = begin + round(config.duration_s * 1e9) if config.duration_s else reader.end_ns
    return begin, end


def main() -> None:
    """Run the player as a process."""
    run_node(Player)


if __name__ == "__main__":
    main()
