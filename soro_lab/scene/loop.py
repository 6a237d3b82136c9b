"""Estimator, controller and closed loop from the keys of nodes and of scenes: built in one place."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from soro_core.config import with_changes
from soro_core.loop import Loop

if TYPE_CHECKING:  # a node needs one half only, and not the modules of the other
    from soro_core.control import Controller
    from soro_core.estimation import Estimator
    from soro_core.robot import Discretisation, Robot
    from soro_hardware import PlatformBase
    from soro_lab.scene import ControllerNodeConfig, EstimatorNodeConfig, Scene


def estimator_of(config: EstimatorNodeConfig, robot: Robot) -> Estimator:
    """Return the estimator that a node's parameters describe.

    Raises
    ------
    ConfigError
        If the parameters do not fit the robot.
    """
    from soro_core.estimation import Estimator

    return Estimator(robot, config.filter, 1.0 / config.rate_hz, config.model)


def controller_of(
    config: ControllerNodeConfig,
    robot: Robot,
    platform: PlatformBase | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Controller:
    """Return the controller that a node's parameters describe.

    Parameters
    ----------
    config : ControllerNodeConfig
    robot : Robot
        As its file describes it.
    platform : PlatformBase, optional
        The platform that `config` names, where it is read already.
    say : callable
        Takes a line for each key of the law that limits or regulators contradict.

    Raises
    ------
    ConfigError
        If the parameters do not fit the robot or the platform.
    """
    from soro_core.control import Controller

    pressures, contradictions = config.known_pressures(platform)
    for line in contradictions:
        say(line)
    return Controller(robot, config.control, config.model, pressures)


def loop_of(scene: Scene, model: Discretisation | None = None) -> Loop:
    """Return the loop that the nodes of a scene make, with its model or another one.

    Raises
    ------
    ConfigError
        If estimator or controller do not fit the robot.
    """
    estimator, controller = scene.estimator_node(), scene.controller_node()
    if model is not None:
        estimator, controller = with_changes(estimator, model=model), with_changes(controller, model=model)
    robot = scene.loaded_robot
    return Loop(estimator_of(estimator, robot), controller_of(controller, robot, scene.loaded_platform))
