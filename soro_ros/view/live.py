"""The page of a running arm: what it does, and the buttons that act on it."""

from __future__ import annotations

from functools import partial
from typing import Literal

import viser
from rclpy.node import Node

from soro_core.robot import Robot
from soro_ros.view.buttons import BUTTONS, Buttons
from soro_ros.view.page import ViewerPage, set_value

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
    """

    def __init__(self, node: Node, server: viser.ViserServer, robot: Robot, payload_kg: float) -> None:
        self.buttons = Buttons(node, self._tell)
        self._answers: list[str] = []
        for name in BUTTONS:
            button = server.gui.add_button(name, color=_COLOURS[name])
            button.on_click(partial(self._press, name))
        self._answer = server.gui.add_text("answers", "", multiline=True, disabled=True)
        super().__init__(server, robot, payload_kg)

    def _press(self, name: str, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        self.buttons.press(name)

    def _tell(self, line: str) -> None:
        self._answers = [*self._answers[-2:], line]
        set_value(self._answer, "\n".join(self._answers))
