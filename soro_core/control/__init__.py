"""Control: the adaptive law, pressure allocation, references."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.control.command import Command as Command
    from soro_core.control.command import ControllerState as ControllerState
    from soro_core.control.command import ControllerStatus as ControllerStatus
    from soro_core.control.config import ControllerConfig as ControllerConfig
    from soro_core.control.controller import Controller as Controller
    from soro_core.control.reference.trajectory import Point as Point
    from soro_core.control.reference.trajectory import Reference as Reference

__all__, __getattr__ = lazy(
    __name__,
    {
        ".command": "Command ControllerState ControllerStatus",
        ".config": "ControllerConfig",
        ".controller": "Controller",
        ".reference.trajectory": "Point Reference",
    },
)
