"""Reduced-order models, control, estimation, pneumatics and device protocols for pneumatic soft arms."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from soro_core.integrate import simulate
    from soro_core.model import SoftArm
    from soro_core.robot import Robot, load_robot, robot_from_dict

__all__ = ["Robot", "SoftArm", "load_robot", "robot_from_dict", "simulate"]

_HOMES = {
    "Robot": "soro_core.robot",
    "SoftArm": "soro_core.model",
    "load_robot": "soro_core.robot",
    "robot_from_dict": "soro_core.robot",
    "simulate": "soro_core.integrate",
}


def __getattr__(name: str) -> Any:
    """Load a public name when first asked for, so that a command without a model starts at once."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
