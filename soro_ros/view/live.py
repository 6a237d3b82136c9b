"""The page of a running arm: what it does, and the buttons that act on it."""

from __future__ import annotations

import queue
import re
import time
from collections.abc import Callable
from functools import partial
from typing import Literal

import viser
from rclpy.node import Node
from std_srvs.srv import Trigger

from soro_core.robot import Robot
from soro_ros.host.services import Call
from soro_ros.view.page import ViewerPage, set_value

LIMIT_S = 20.0
BUTTONS = ("enable", "vent", "reset")
"""Names of the buttons, and of the services that they call."""


class Buttons:
    """Calls services for buttons; `press` from any thread, `work` from that of the node.

    Parameters
    ----------
    node : Node
        Owner of the calls; its namespace is that of the arm.
    tell : callable
        Takes a line for each answer.
    """

    def __init__(self, node: Node, tell: Callable[[str], None]) -> None:
        self._node, self._tell = node, tell
        self._pressed: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._calls: list[tuple[str, float, Call]] = []

    def press(self, button: str) -> None:
        """Ask for what a button says."""
        self._pressed.put(button)

    def work(self) -> None:
        """Call the requested service and report its answer."""
        while not self._pressed.empty():
            self._begin(self._pressed.get())
        waiting, self._calls = self._calls, []
        for service, begin_s, call in waiting:
            waited_s = time.monotonic() - begin_s
            if call.done():
                answer = call.response
                self._tell(f"{service}: {'' if answer.success else 'refused: '}{answer.message}")
            elif waited_s > LIMIT_S:
                self._tell(call.failure(LIMIT_S))
            else:
                self._calls.append((service, begin_s, call))
                continue
            call.close()

    def close(self) -> None:
        """Give up what is not answered yet."""
        for _, _, call in self._calls:
            call.close()
        self._calls.clear()

    def _begin(self, button: str) -> None:
        found = self._services(button)
        if not found:
            self._tell(f"{button}: no node in {self._node.get_namespace()} offers it")
        for service in found:
            call = Call(self._node, Trigger, service, Trigger.Request())
            self._calls.append((service.lstrip("/"), time.monotonic(), call))

    def _services(self, button: str) -> list[str]:
        """Return the services of an arm's nodes of one name.

        All of them vent; but a controller's reset only begins its reference again, so that `reset` is that
        of the node with the latch.
        """
        node = self._node
        prefix = node.get_namespace().rstrip("/") + "/"
        names = [name for name, _ in node.get_service_names_and_types()]
        drivers = {
            f"{one.node_namespace.rstrip('/')}/{one.node_name}/{button}"
            for one in node.get_publishers_info_by_topic(f"{prefix}chambers/state")
        }
        own = f"{re.escape(prefix)}[^/]+/{button}"  # the driver of arms that share their valves is outside
        return [name for name in names if name in drivers or (button != "reset" and re.fullmatch(own, name))]


_COLOURS: dict[str, Literal["green", "red", "gray"]] = {"enable": "green", "vent": "red", "reset": "gray"}


class LivePage(ViewerPage):
    """A `ViewerPage` with buttons.

    Parameters
    ----------
    node : Node
        Calls the services; its namespace is that of the arm.
    server : viser.ViserServer
    robot : Robot
    payload_kg : float
    arm, carrier : str
        Name of one of several arms, and of the one at whose tip it is.
    """

    def __init__(
        self,
        node: Node,
        server: viser.ViserServer,
        robot: Robot,
        payload_kg: float,
        arm: str = "",
        carrier: str = "",
    ) -> None:
        self.buttons = Buttons(node, self._tell)
        self._answers: list[str] = []
        for name in BUTTONS:
            button = server.gui.add_button(f"{name} {arm}".rstrip(), color=_COLOURS[name])
            button.on_click(partial(self._press, name))
        self._answer = server.gui.add_text(f"answers {arm}".rstrip(), "", multiline=True, disabled=True)
        super().__init__(server, robot, payload_kg, arm, carrier)

    def _press(self, name: str, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        self.buttons.press(name)

    def _tell(self, line: str) -> None:
        self._answers = [*self._answers[-2:], line]
        set_value(self._answer, "\n".join(self._answers))
