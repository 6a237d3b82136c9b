"""What comes in a frame that is not the expected one is refused, named once and counted."""

from __future__ import annotations

from collections.abc import Callable

from soro_core.errors import short
from soro_core.run_keys import Frames
from soro_ros.topics.ports import ignore

# Frames that are named in the log; a publisher that makes up new ones does not fill it.
_MOST = 100


class FrameCheck:
    """The frames of the messages that a node takes.

    Parameters
    ----------
    frames : Frames
        Configured names.
    warn : callable
        Takes a line for the log, once for each topic and frame that is refused.
    report : callable
        Takes what is refused now, at each change; an empty text for nothing.

    Attributes
    ----------
    refused : dict of str to int
        Refused messages by the name of their topic.
    """

    def __init__(
        self,
        frames: Frames,
        warn: Callable[[str], None] = ignore,
        report: Callable[[str], None] = ignore,
    ) -> None:
        self._frames, self._warn, self._report = frames, warn, report
        self.refused: dict[str, int] = {}
        self._named: set[str] = set()
        self._last: dict[str, str] = {}  # why the last message of a topic was refused

    def takes_sample(self, topic: str, frame: str) -> bool:
        """Return whether a sample on a topic may be used; an empty frame, none stated, always fits."""
        number = topic.removeprefix("sensors/imu")
        if number == topic:
            key = "frames.pose" if self._frames.pose else "frames.world"
            return self._takes(topic, frame, self._frames.of_poses, key)
        return self._takes(topic, frame, self._frames.of_imu(int(number)), "frames.imu")

    def takes_in_world(self, topic: str, frame: str) -> bool:
        """Return whether a message of a topic whose frame is the world may be used; arguments as above."""
        return self._takes(topic, frame, self._frames.world, "frames.world")

    @property
    def refusal(self) -> str:
        """Which topics are refused now, and why; empty if none is."""
        return "; ".join(self._last.values())

    @property
    def values(self) -> dict[str, object]:
        """Counts for /diagnostics."""
        return {f"refused {topic}": count for topic, count in self.refused.items()}

    def _takes(self, topic: str, frame: str, allowed: str, key: str) -> bool:
        if frame == "" or allowed in ("", frame):
            if self._last.pop(topic, None):
                self._report(self.refusal)
            return True
        self.refused[topic] = self.refused.get(topic, 0) + 1
        text = f"{topic} refused: frame {short(frame)}; allowed: {allowed} ({key}), or none"
        is_new = self._last.get(topic) != text
        self._last[topic] = text
        if is_new:
            self._report(self.refusal)
        if text not in self._named and len(self._named) < _MOST:
            self._named.add(text)
            self._warn(text)
        return False
