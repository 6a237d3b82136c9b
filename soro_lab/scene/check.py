"""Checks of a scene against its robot, its platform and its gains, before anything starts."""

from __future__ import annotations

from pathlib import Path

from soro_core.bodies.body import check_attachments
from soro_core.control.config import require_chambers
from soro_core.errors import ConfigError
from soro_core.robot import Discretisation, Robot, load_robot
from soro_core.robot.discretisation import EXPLICIT
from soro_core.twin.config import beside_bodies, check_volumes, described_plant
from soro_hardware import PlatformBase
from soro_lab.scene.limits import unused_range
from soro_lab.scene.scene import Scene


def check_scene(scene: Scene, where: str) -> list[str]:
    """Refuse a scene, its model known, that does not fit the robot and the platform that it names.

    Returns
    -------
    list of str
        Lines for the user: ranges that are not used, a base that moves, faults after the end of the run, keys
        that limits or regulators contradict.

    Raises
    ------
    ConfigError
        One line with file, key, what was found and what is allowed.
    """
    if (scene.bodies or scene.mounts) and scene.arm == "simulated":
        _check_bodies(scene, where)
    if scene.arms:
        _check_arms(scene, where)
        arms = [(arm, check_scene(arm, _place(where, arm))) for arm in scene.each]
        return [f"{arm.prefix}{line}" for arm, lines in arms for line in lines]
    check_plant(scene, where)
    moves = scene.twin.base_by_topic or scene.twin.base_shake.moves
    late = [fault for fault in scene.faults if fault.at >= scene.duration_s]
    return [
        *unused_range(scene),
        *(["twin: the base moves; estimator and controller believe in one at rest"] if moves else []),
        *(f"{fault} at {fault.at:g} s: the run ends at {scene.duration_s:g} s" for fault in late),
        *(f"controller.{line}" for line in scene.controller_node().known_pressures(scene.loaded_platform)[1]),
    ]


def arm_of(scene: Scene, wanted: str | None, where: str) -> Scene:
    """Return the scene of one arm by its name, ``left`` or ``hand/left``; a scene of one arm as it is.

    Parameters
    ----------
    scene : Scene
    wanted : str or None
    where : str
        What the error names.

    Raises
    ------
    ConfigError
        If there are several, and none of them has the name.
    """
    found = [arm for arm in scene.each if (wanted or "").strip("/") in (arm.name, arm.prefix.rstrip("/"))]
    if scene.arms and not found:
        raise ConfigError(where, "arm", wanted or "nothing", f"one of {', '.join(scene.arms)}")
    return found[0] if scene.arms else scene


def require_one_arm(scene: Scene, where: str) -> Scene:
    """Return a scene of one arm, and of nothing else, for those whose twin is alone.

    Raises
    ------
    ConfigError
        If it has several arms, or bodies.
    """
    if scene.bodies:
        allowed = "none: only soro run without --learn-from, view, plot, report, replay and bag know bodies"
        raise ConfigError(where, "bodies", ", ".join(scene.bodies), allowed)
    if scene.arms:
        allowed = "a scene of one arm: only soro run, view, plot, report, replay and bag know several"
        raise ConfigError(where, "arms", ", ".join(scene.arms), allowed)
    return scene


def check_plant(scene: Scene, where: str) -> None:
    """Refuse a robot, a platform and a model that do not fit each other, whatever commands them.

    Raises
    ------
    ConfigError
        One line with file, key, what was found and what is allowed.
    """
    robot = scene.loaded_robot
    require_chambers(robot, where)
    if scene.loaded_platform is not None:
        _check_platform(scene, scene.loaded_platform, robot)
    check_model(scene, robot, where)


def check_model(scene: Scene, robot: Robot, where: str) -> None:
    """Refuse a model that the robot cannot have, in the nodes or in the twin.

    Parameters
    ----------
    scene : Scene
        Scene, with its model stated or chosen.
    robot : Robot
        Robot of the scene.
    where : str
        File of the scene, for the error.

    Raises
    ------
    ConfigError
        One line with file, key, what was found and what prevents it.
    """
    twin = scene.twin_node()
    plant = described_plant(robot, twin)
    _check("model", scene.discretisation, robot, 1, where)
    _check("twin.refine" if twin.refine > 1 else "model", twin.model, plant, twin.refine, where)
    if twin.air == "states":
        _check_air(twin.integrator, plant, where)


def check_learned(scene: Scene, where: str) -> None:
    """Refuse learned numbers that are not those of the robot and the model of the scene, or out of bounds.

    Raises
    ------
    ConfigError
        One line with file, key, what was found and what is allowed.
    """
    law, options = scene.controller.law, scene.controller.law_options
    if not options.get("learned"):
        return
    from soro_core.adaptation.learner import Learner
    from soro_core.control.laws.composite import CompositeOptions
    from soro_core.control.laws.registry import options_of
    from soro_core.model.discretised import discretised

    given, model = options_of(law, options), scene.discretisation
    if not isinstance(given, CompositeOptions):  # what `learned` of another law is, it says itself
        return
    try:
        Learner(discretised(scene.loaded_robot, model), given, model.links, given.learned)
    except ConfigError as error:
        raise ConfigError(where, error.key, error.got, error.allowed) from None


def check_gains(scene: Scene, robot: Robot, where: str) -> str:
    """Refuse gains that are those of another robot.

    Stated gains count as those of `controller.robot`, and without this key as those of the scene's robot;
    automatic ones are those of the robot.

    Parameters
    ----------
    scene : Scene
    robot : Robot
    where : str
        File of the scene, for the error.

    Returns
    -------
    str
        A line for the user if stated gains name no robot and count as those of this one; else empty.

    Raises
    ------
    ConfigError
        The message names the robot of the gains.
    """
    owner = scene.gains_robot
    if not scene.controller.gains.stated:
        return ""
    if owner in (scene.robot, robot.name):
        named = bool(scene.controller.robot)
        return "" if named else f"controller.gains name no robot: taken for those of {robot.name}"
    try:
        name = load_robot(owner).name
    except ConfigError:  # the file of that robot no longer exists
        name = Path(owner).stem
    if name == robot.name:
        return ""
    allowed = (
        f"controller.gains: auto, or gains for {robot.name}, or controller.robot: {scene.robot} if these are "
        "known to fit it"
    )
    raise ConfigError(where, "controller.gains", f"gains of {name}", allowed)


def _check_platform(scene: Scene, platform: PlatformBase, robot: Robot) -> None:
    platform = platform.at_rate(scene.rate_hz)
    if scene.valves == "real" and not scene.own_device:
        allowed = f"--device, or {platform.where_device} in the platform file: where the valves are"
        raise ConfigError(scene.platform, "device", "", allowed)
    if not scene.prefix or not scene.is_shared:  # those of several arms `_check_arms` compares
        _check_chambers(scene, platform, robot.chamber_names, f"robot {scene.robot}")


def _check_chambers(scene: Scene, platform: PlatformBase, has: tuple[str, ...], whose: str) -> None:
    """Refuse a platform that does not have one valve for each chamber."""
    fed = platform.chamber_names
    if set(fed) != set(has):
        other = [f"{name}, which {whose} does not have" for name in fed if name not in has]
        other += [f"no {name}" for name in has if name not in fed]
        allowed = f"one valve for each chamber of {whose}: {', '.join(has)}"
        raise ConfigError(scene.platform, "valves", f"{len(fed)} valves: {other[0]}", allowed)


def _check_bodies(scene: Scene, where: str) -> None:
    """Refuse bodies with the name of an arm, and twins that do not go with bodies."""
    names = list(scene.arms) or ["arm"]
    if both := [name for name in names if name in scene.bodies]:
        raise ConfigError(where, f"bodies.{both[0]}", both[0], "a name that no arm has")
    lengths = [arm.loaded_robot.length for arm in scene.each]
    check_attachments(scene.bodies, dict(zip(names, lengths, strict=True)), where)
    for arm in scene.each:
        robots = (
            [arm.loaded_robot, described_plant(arm.loaded_robot, arm.twin_node())] if arm.mounted_on else []
        )
        if any(one.contacts or one.tip_constraint for one in robots):
            allowed = "none of them in the file of an arm that another one carries"
            raise ConfigError(_place(where, arm), "robot", "contacts or tip_constraint", allowed)
        if allowed := beside_bodies(arm.twin):
            what = "bodies in the scene" if scene.bodies else "arms that another one carries"
            raise ConfigError(_place(where, arm), "twin", what, f"{allowed} beside them")


def _check_arms(scene: Scene, where: str) -> None:
    """Refuse arms that do not fit the platform that they share, or have one device twice."""
    shared = [arm for arm in scene.each if arm.is_shared]
    for arm in shared:
        if arm.platform != scene.platform:
            allowed = f"that of the scene, {scene.platform or 'none'}, or a platform of one arm"
            raise ConfigError(_place(where, arm), "platform", arm.platform, allowed)
        if arm.twin.air == "states":
            allowed = "lag, with a platform that several arms share"
            raise ConfigError(_place(where, arm), "twin.air", arm.twin.air, allowed)
    if shared and scene.loaded_platform is not None:
        has = tuple(f"{arm.prefix}{name}" for arm in shared for name in arm.loaded_robot.chamber_names)
        group = ", ".join(arm.prefix.rstrip("/") for arm in shared)
        _check_chambers(scene, scene.loaded_platform, has, f"the group {group}")
    devices: dict[str, Scene] = {}
    for one in scene.platforms if scene.valves == "real" else ():
        device = one.own_device
        if device in devices:
            allowed = f"another one than {devices[device].prefix or 'the scene'} has: its valves are its own"
            raise ConfigError(_place(where, one), "device", device, allowed)
        devices[device] = one


def _place(where: str, arm: Scene) -> str:
    """Return the place of an arm in a file, for errors."""
    return f"{where}: arms.{arm.prefix.rstrip('/')}" if arm.prefix else where


def _check_air(integrator: str, robot: Robot, where: str) -> None:
    if integrator in EXPLICIT:
        allowed = f"an implicit integrator of the twin, not {integrator}; or lag"
        raise ConfigError(where, "twin.air", "states", allowed)
    check_volumes(robot, where, "twin.air")


def _check(key: str, model: Discretisation, robot: Robot, refine: int, where: str) -> None:
    try:
        model.discretise(robot.refine(refine))
    except ConfigError as error:
        stated = model.model_dump(exclude_defaults=True)
        if refine > 1:
            stated["refine"] = refine
        got = ", ".join(f"{name} {value}" for name, value in stated.items())
        raise ConfigError(where, key, got, f"what the robot can have ({error})") from None
