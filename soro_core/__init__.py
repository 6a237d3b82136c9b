"""Model, control, estimation, safety, twin and closed loop of pneumatic soft arms."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.control.laws.protocol import Law as Law
    from soro_core.control.laws.protocol import LawOptions as LawOptions
    from soro_core.control.motions.kinematics import inverse_kinematics as inverse_kinematics
    from soro_core.control.reachable_workspace import reachable as reachable
    from soro_core.integrate.simulate import simulate as simulate
    from soro_core.integrate.simulate_many import simulate_many as simulate_many
    from soro_core.jobs.versions import __version__ as __version__
    from soro_core.loop import Loop as Loop
    from soro_core.model import SoftArm as SoftArm
    from soro_core.model.equilibrium.statics import equilibrium as equilibrium
    from soro_core.model.equilibrium.statics import stable_equilibrium as stable_equilibrium
    from soro_core.planning.around import plan_around as plan_around
    from soro_core.robot import BaseState as BaseState
    from soro_core.robot import Robot as Robot
    from soro_core.robot import Shake as Shake
    from soro_core.robot import load_robot as load_robot
    from soro_core.robot import robot_from_dict as robot_from_dict
    from soro_core.robot import save_robot as save_robot

__all__, __getattr__ = lazy(
    __name__,
    {
        ".control.laws.protocol": "Law LawOptions",
        ".control.motions.kinematics": "inverse_kinematics",
        ".control.reachable_workspace": "reachable",
        ".integrate": "simulate simulate_many",
        ".jobs.versions": "__version__",
        ".loop": "Loop",
        ".model": "SoftArm",
        ".model.equilibrium.statics": "equilibrium stable_equilibrium",
        ".planning.around": "plan_around",
        ".robot": "BaseState Robot Shake load_robot robot_from_dict save_robot",
    },
)
