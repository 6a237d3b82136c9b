"""Model, control, estimation, safety, twin and closed loop of pneumatic soft arms."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.integrate.simulate import simulate as simulate
    from soro_core.integrate.simulate_many import simulate_many as simulate_many
    from soro_core.model import SoftArm as SoftArm
    from soro_core.robot import Robot as Robot
    from soro_core.robot import load_robot as load_robot
    from soro_core.robot import robot_from_dict as robot_from_dict

__all__, __getattr__ = lazy(
    __name__,
    {
        ".integrate": "simulate simulate_many",
        ".model": "SoftArm",
        ".robot": "Robot load_robot robot_from_dict",
    },
)
