"""Control: the adaptive law, pressure allocation, references."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.control.command import Command, ControllerState, ControllerStatus
    from soro_core.control.config import ControllerConfig
    from soro_core.control.controller import Controller
    from soro_core.control.reference.trajectory import Point, Reference

__all__ = [
    "Command",
    "Controller",
    "ControllerConfig",
    "ControllerState",
    "ControllerStatus",
    "Point",
    "Reference",
]

__getattr__ = lazy(
    __name__,
    {
        "Command": "soro_core.control.command",
        "Controller": "soro_core.control.controller",
        "ControllerConfig": "soro_core.control.config",
        "ControllerState": "soro_core.control.command",
        "ControllerStatus": "soro_core.control.command",
        "Point": "soro_core.control.reference.trajectory",
        "Reference": "soro_core.control.reference.trajectory",
    },
)
