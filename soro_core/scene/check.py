"""What a scene asks of a robot, before anything starts."""

from __future__ import annotations

from soro_core.errors import ConfigError
from soro_core.robot import Discretisation, Robot
from soro_core.robot.discretisation import EXPLICIT
from soro_core.scene.scene import Scene
from soro_core.twin.config import check_volumes


def check_model(scene: Scene, robot: Robot, where: str) -> None:
    """Refuse a model that the robot cannot have, in the nodes or in the twin.

    Parameters
    ----------
    scene : Scene
        With its model stated or chosen.
    robot : Robot
        The one that the scene names.
    where : str
        File of the scene, for the error.

    Raises
    ------
    ConfigError
        One line with file, key, what was found and what is in the way.
    """
    twin = scene.twin_node()
    _check("model", scene.discretisation, robot, 1, where)
    _check("twin.refine" if twin.refine > 1 else "model", twin.model, robot, twin.refine, where)
    if twin.air == "states":
        _check_air(twin.integrator, robot, where)


def _check_air(integrator: str, robot: Robot, where: str) -> None:
    if integrator in EXPLICIT:
        allowed = f"an implicit integrator of the twin, not {integrator}; or lag"
        raise ConfigError(where, "twin.air", "states", allowed)
    check_volumes(robot, where, "twin.air")


def _check(key: str, model: Discretisation, robot: Robot, refine: int, where: str) -> None:
    try:
        model.shape(robot.refine(refine))
    except ConfigError as error:
        stated = model.model_dump(exclude_defaults=True)
        if refine > 1:
            stated["refine"] = refine
        got = ", ".join(f"{name} {value}" for name, value in stated.items())
        raise ConfigError(where, key, got, f"what the robot can have ({error})") from None
