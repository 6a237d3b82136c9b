"""Model, control, estimation, safety, twin and closed loop of pneumatic soft arms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.integrate.simulate import simulate
    from soro_core.integrate.simulate_many import simulate_many
    from soro_core.model import SoftArm
    from soro_core.robot import Robot, load_robot, robot_from_dict

__all__ = ["Robot", "SoftArm", "load_robot", "robot_from_dict", "simulate", "simulate_many"]

__getattr__ = lazy(
    __name__,
    {
        "Robot": "soro_core.robot",
        "SoftArm": "soro_core.model",
        "load_robot": "soro_core.robot",
        "robot_from_dict": "soro_core.robot",
        "simulate": "soro_core.integrate",
        "simulate_many": "soro_core.integrate",
    },
)
