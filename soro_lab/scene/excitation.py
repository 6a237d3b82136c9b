"""The excitation that a scene describes; it needs the model, which a scene does without."""

from __future__ import annotations

from soro_core.errors import ConfigError
from soro_core.model.discretised import discretised
from soro_core.robot import Robot
from soro_hardware import PlatformBase
from soro_lab.excitation.foresight import foresee
from soro_lab.excitation.motion import MotionCriteria
from soro_lab.excitation.plan import make_plan
from soro_lab.excitation.procedure import Excitation
from soro_lab.excitation.supply import supply_of
from soro_lab.scene.nodes import ExciterNodeConfig


def excitation_of(
    config: ExciterNodeConfig,
    robot: Robot,
    platform: PlatformBase | None = None,
    where: str = "parameters of exciter",
) -> Excitation:
    """Return plan, limits of motion and the model's warning.

    Parameters
    ----------
    config : ExciterNodeConfig
        Parameters of the exciter node.
    robot : Robot
        Robot as its file describes it.
    platform : PlatformBase, optional
        The platform that the configuration names, where it is read already.
    where : str
        File or node of the configuration, for errors.

    Raises
    ------
    ConfigError
        If no sensor shows the motion of the arm, or the limits leave no excitation.
    """
    poses = config.pose_locations if config.pose_rate_hz else ()
    imus = config.imu_locations if config.imu_rate_hz else ()
    if not poses and not imus:
        allowed = "true here or for twin.imu: an excitation is limited by the motion that a sensor shows"
        raise ConfigError(where, "twin.pose.enabled", False, allowed)
    wanted = config.excite
    if wanted.motion.box_m and not poses:
        allowed = "none without a pose sensor; bend_rad limits what an IMU shows"
        raise ConfigError(where, "excite.motion.box_m", wanted.motion.box_m, allowed)
    limits, response = config.known_limits(config.rate_hz, platform)
    plan = make_plan(supply_of(robot, limits, response, wanted, config.rate_hz, where), wanted, where)
    warned = foresee(discretised(robot, config.model), plan)
    kind, places = ("pose", poses) if poses else ("imu", imus)
    outermost = f"{kind}{max(range(len(places)), key=lambda k: places[k])}"
    return Excitation(plan, MotionCriteria(wanted.motion, robot.length, bool(poses)), warned, outermost)
