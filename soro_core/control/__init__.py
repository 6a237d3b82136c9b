"""Control: the adaptive law, pressure allocation, references."""

from soro_core.control.command import Command, ControllerState, ControllerStatus
from soro_core.control.config import ControllerConfig
from soro_core.control.controller import Controller
from soro_core.control.trajectory import Point, Reference

__all__ = [
    "Command",
    "Controller",
    "ControllerConfig",
    "ControllerState",
    "ControllerStatus",
    "Point",
    "Reference",
]
