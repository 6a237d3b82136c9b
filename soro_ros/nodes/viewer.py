"""The viewer node: the arm of its namespace in a browser, with buttons for those who have the token.

The arms of a scene are nodes of one process, which share a page: `soro_viewer /hand/left /hand/right`.
"""

from __future__ import annotations

import os
import sys
import time
from collections import deque
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from soro_core.errors import SoroError
from soro_core.extras import named_packages
from soro_core.robot import load_robot
from soro_ros.conversion.messages import is_pose, transform
from soro_ros.process import command_line
from soro_ros.process.lifecycle import SoroNode
from soro_ros.process.node_process import run_nodes
from soro_ros.topics.diagnostics import OK
from soro_ros.view.config import ViewerConfig
from soro_ros.view.moment import DIAGNOSTICS, LATCH, TOPICS, Moment, Received

# A reader that never slows down a writer.
_LAST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_PROFILES = {
    DIAGNOSTICS: QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT),
    LATCH: QoSProfile(
        depth=1,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    ),
}
# Period in which pressed buttons are noticed [s].
_BUTTON_S = 0.05
# The loop goes first.
NICE = 10


class Screen:
    """The page of several viewers.

    Parameters
    ----------
    arms : int
        Number of arms on it.

    Attributes
    ----------
    server : ViewServer or None
        That of the page; None before the first node is configured and behind its end.
    """

    def __init__(self, arms: int = 1) -> None:
        self.arms = arms
        self.server: Any = None
        self._address, self._missing = "", max(arms, 1)

    def open(self, config: ViewerConfig) -> Any:
        """Return the server; the first node opens it."""
        from soro_ros.view.access import Access
        from soro_ros.view.server import ViewServer

        if self.server is None:
            access = Access()
            self.server = ViewServer(access, config.port)
            self._address = access.address(self.server.get_port())
        return self.server

    def complete(self, config: ViewerConfig) -> None:
        """Note that the page has one more arm; the last node tells the address."""
        self._missing -= 1
        if self._missing <= 0:
            _announce(self._address, config.address_file)

    def close(self) -> None:
        """Stop the server; may be called again."""
        server, self.server = self.server, None
        if server is not None:
            server.stop()


class Viewer(SoroNode[ViewerConfig]):
    """Reads the newest message of each topic at its own rate, and draws it while somebody looks."""

    config_model = ViewerConfig
    node_name = "viewer"
    is_observer = True
    _server: Any = None

    def __init__(self, namespace: str | None = None, screen: Screen | None = None) -> None:
        self._screen = screen or Screen()
        super().__init__(namespace)

    def setup(self, config: ViewerConfig) -> None:
        with named_packages():
            from soro_ros.view.live import LivePage

            self._server = self._screen.open(config)
        self._config, robot = config, load_robot(config.robot)
        arm = self.get_namespace().rpartition("/")[2] if self._screen.arms > 1 else ""
        self._page = LivePage(self, self._server, robot, config.payload_kg, arm, config.mounted_on)
        self._received = Received(self.get_namespace())
        self._past: deque[Moment] = deque(maxlen=round(config.trail_s * config.rate_hz))
        # In no executor: a message does not wake this process, the newest one is taken when it is drawn.
        self._listener = Node(
            "_viewer_topics", namespace=self.get_namespace(), start_parameter_services=False
        )
        self._subscriptions_of = {
            topic: self._listener.create_subscription(kind, topic, _ignore, _PROFILES.get(topic, _LAST))
            for topic, kind in TOPICS.items()
        }
        self._bodies: Any = None
        self._body_poses: dict[str, Subscription] = {}
        if config.bodies_file:
            self._make_bodies(config.bodies_file)
        self._screen.complete(config)

    def _make_bodies(self, file: str) -> None:
        """Draw what the arms touch; its topics are those of the scene, which is around several arms."""
        from soro_core.bodies.files import load_bodies
        from soro_ros.view.drawn_bodies import DrawnBodies

        bodies, own = load_bodies(file), self.get_namespace().rstrip("/")
        scene = own.rpartition("/")[0] if self._screen.arms > 1 else own
        self._bodies = DrawnBodies(self._server, bodies)
        self._body_poses = {
            name: self._listener.create_subscription(
                PoseStamped, f"{scene}/bodies/{name}/pose", _ignore, _LAST
            )
            for name in bodies
        }

    def start(self) -> None:
        self.every(1.0 / self._config.rate_hz, self._draw)
        self.every(_BUTTON_S, self._page.buttons.work)

    def teardown(self) -> None:
        self.make_safe()

    def make_safe(self) -> None:
        server, self._server = self._server, None
        if server is not None:
            self._screen.close()
            self._page.buttons.close()
            self._listener.destroy_node()

    def diagnose(self) -> None:
        if self._server is not None:
            looking = len(self._server.get_clients())
            self.diagnostics.update(OK, "active", {"port": self._server.get_port(), "looking": looking})

    def _draw(self) -> None:
        now_s = time.monotonic()
        for topic, subscription in self._subscriptions_of.items():
            for message in _taken(subscription):
                self._received.take(topic, message, now_s)
        moment = self._received.moment(now_s)
        if self._past and moment.t_s < self._past[-1].t_s:  # a run began anew
            self._past.clear()
        self._past.append(moment)
        poses = {name: _taken(one)[-1:] for name, one in self._body_poses.items()}
        if self._server.get_clients():
            self._page.show(self._past)
            if self._bodies is not None:
                known = {name: last[0].pose for name, last in poses.items() if last}
                self._bodies.show({name: transform(pose) for name, pose in known.items() if is_pose(pose)})


def _taken(subscription: Subscription) -> list[Any]:
    """Take what has arrived since the last time, as many messages as its history holds."""
    found = []
    with subscription.handle:
        while (taken := subscription.handle.take_message(subscription.msg_type, False)) is not None:
            found.append(taken[0])
    return found


def _ignore(message: object) -> None:
    """Messages are taken, not called back."""


def _announce(address: str, file: str) -> None:
    """Give the address with its token to the user alone."""
    if not file:
        print(f"view: {address}", flush=True)
        return
    try:
        descriptor = os.open(Path(file), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise SoroError(f"{file}: cannot be written: {error.strerror}") from None
    with os.fdopen(descriptor, "w") as out:
        out.write(address)


def main() -> None:
    """Run the viewer as a process."""
    os.nice(NICE)
    run_viewers(*command_line.namespaces(sys.argv[1:]))


def run_viewers(namespaces: Sequence[str], arguments: list[str]) -> None:
    """Run the viewers of arms, which share a page, by arguments of ROS; without a namespace that of those."""
    screen = Screen(len(namespaces))
    arms = [partial(Viewer, namespace, screen) for namespace in namespaces] or [partial(Viewer)]
    run_nodes(arms, command_line.of_node(Viewer.node_name, ViewerConfig), arguments)


if __name__ == "__main__":
    main()
