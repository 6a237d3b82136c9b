"""Reading a scene file: what it names is found beside it, options change its keys; the shipped scenes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from soro_core.bodies.body import check_mounts
from soro_core.bodies.files import find_shapes
from soro_core.config import config_folder, find_config, parse, read_yaml, with_changes
from soro_core.control.laws.registry import with_folder
from soro_core.errors import ConfigError
from soro_core.grasping.settings import HandKeys
from soro_core.safety import check_rating, rating_of
from soro_lab.scene.limits import default_limits
from soro_lab.scene.scene import Scene
from soro_lab.scene.sections import OF_RUN

_TEXTS = ("name", "description", "platform")
# What a namespace of ROS may be called.
_ARM = re.compile(r"[a-z][a-z0-9_]*")


def load_scene(name: str | Path, changes: dict[str, Any] | None = None) -> Scene:
    """Read a scene, by path or by name, with changes like ``{"controller.adapt": False}`` applied.

    Files that it names are found beside it, else from the working directory; those of the changes from there.

    Raises
    ------
    ConfigError
        Naming the file, the key, what was found and what is allowed.
    """
    path = find_config(name, "scenes")
    data = read_yaml(path)
    _find_files(data, path.parent)
    for key, value in (changes or {}).items():
        _set(data, key, value, str(path))
        _find_files(data, Path())
    # A text without a value, `platform:`, is none.
    data = {key: value for key, value in data.items() if value is not None or key not in _TEXTS}
    data.setdefault("name", path.stem)
    if "/" in str(data["name"]):
        raise ConfigError(str(path), "name", data["name"], "lower-case letters, digits and _")
    scene = (_of_arms if data.get("arms") else _of_one_arm)(data, str(path))
    if scene.mounted_on and not scene.arms:
        raise ConfigError(str(path), "mounted_on", scene.mounted_on, "an arm of a scene of several arms")
    if any(one.controller.joint for one in (scene, *scene.arms.values())):
        _check_joints(scene, str(path))
    return scene


def _of_one_arm(data: dict[str, Any], where: str) -> Scene:
    """Return the scene of an arm, with what follows from its robot and its platform."""
    scene = parse(data, Scene, where=where)
    if scene.hand is not None:
        raise ConfigError(where, "hand", "one arm", "a scene of several arms, its fingers")
    platform = scene.loaded_platform
    if scene.twin.regulator is not None:  # written, a part of its keys is all of them
        scene = scene.with_keys(twin=with_changes(scene.twin, regulator=scene.regulator))
    scene = scene.with_keys(limits=default_limits(scene, where))
    rating = platform.rating if platform else rating_of(scene.loaded_robot.pressure_range_pa)
    check_rating(scene.limits, rating, where=where)
    for number, fault in enumerate(scene.faults):
        if platform and fault.chamber and fault.chamber not in platform.chamber_names:
            allowed = f"one of {', '.join(platform.chamber_names)}"
            raise ConfigError(where, f"faults[{number}].chamber", fault.chamber, allowed)
    return scene


def _check_joints(scene: Scene, where: str) -> None:
    """Refuse a joint in lockstep that the scene has not: each tick would wait for it."""
    hinged = [name for name, body in scene.bodies.items() if body.hinge is not None]
    joints = [f"/{scene.name}/bodies/{name}/joint" for name in hinged]
    if not scene.arms:  # within the namespace of its only arm
        joints += [f"bodies/{name}/joint" for name in hinged]
    for arm in scene.each:
        if scene.mode == "lockstep" and arm.controller.joint not in ("", *joints):
            allowed = f"in lockstep that of a hinged body: {', '.join(joints) or 'the scene has none'}"
            raise ConfigError(where, "controller.joint", arm.controller.joint, allowed)


def _of_arms(data: dict[str, Any], where: str) -> Scene:
    """Return a scene of several arms: each has the keys of the scene where it states none of its own.

    The arms on one platform have its limits in common: the range that all of them allow.
    """
    own = data.pop("arms")
    if not isinstance(own, dict):
        raise ConfigError(where, "arms", own, "a mapping of names to what each arm has of its own")
    whole = parse(data, Scene, where=where)
    for key in ("bodies", "hand"):
        data.pop(key, None)
    arms: dict[str, Scene] = {}
    for number, (name, stated) in enumerate(own.items()):
        keys: dict[str, Any] = {} if stated is None else stated
        key = f"arms.{name}"
        if not (isinstance(name, str) and _ARM.fullmatch(name)):
            raise ConfigError(where, "arms", name, "names of lower-case letters, digits and _")
        if not isinstance(keys, dict):
            raise ConfigError(where, key, keys, "a mapping of keys, or nothing")
        if foreign := [one for one in OF_RUN if one in keys]:
            allowed = "at the top of the scene, for all arms"
            raise ConfigError(where, f"{key}.{foreign[0]}", keys[foreign[0]], allowed)
        # The noise of one arm is not that of another.
        given: dict[str, Any] = {"seed": whole.seed + number, **keys}
        merged = _merged(data, given)
        arms[name] = _of_one_arm(merged | {"name": f"{whole.name}/{name}"}, f"{where}: {key}")
        if arms[name].is_shared and "limits" in keys:
            allowed = "at the top of the scene, for all arms of the platform"
            raise ConfigError(where, f"{key}.limits", keys["limits"], allowed)
    shared = [arm.limits for arm in arms.values() if arm.is_shared]
    if shared:
        low, high = max(one.minimum_pa for one in shared), min(one.maximum_pa for one in shared)
        limits = with_changes(shared[0], minimum_pa=low, maximum_pa=high)
        arms = {name: arm.with_keys(limits=limits) if arm.is_shared else arm for name, arm in arms.items()}
        whole = whole.with_keys(limits=limits)
    whole = whole.with_keys(arms=_carried(whole.with_keys(arms=arms), own, where))
    if whole.hand is not None:
        _check_hand(whole, whole.hand, where)
    return whole


def _carried(scene: Scene, own: dict[str, Any], where: str) -> dict[str, Scene]:
    """Return the arms of a scene, those that another one carries last: their world is the tip of that one.

    `own`: what each arm states of its own; what the scene states of its world is not that of a carried arm.
    """
    arms = dict(sorted(scene.arms.items(), key=lambda item: bool(item[1].mounted_on)))
    check_mounts(scene.mounts, list(arms), where)
    for name, carrier_name in scene.mounts.items():
        arm, carrier = arms[name], arms[carrier_name]
        if "world" in (own[name].get("frames") or {}):
            arm = arm.with_keys()
        else:
            arm = arm.with_keys(
                frames=with_changes(arm.frames, world=carrier.frames.within(carrier.name).tip)
            )
        vars(arm).pop("loaded_robot", None)
        vars(arm)["loaded_carrier"], arms[name] = carrier.loaded_robot, arm
    return arms


def _check_hand(scene: Scene, hand: HandKeys, where: str) -> None:
    """Refuse a hand of arms that differ, that would wait for ever, or whose pressures a feedback changes."""
    if len(scene.fingers) < 2:
        raise ConfigError(where, "arms", len(scene.fingers), "two or more fingers of a hand")
    for name, arm in scene.arms.items() if scene.mounts else ():
        carrier = next(iter(scene.mounts.values()))
        if arm.mounted_on != carrier and name != carrier:
            allowed = f"{carrier}, which carries the other fingers of the hand"
            raise ConfigError(f"{where}: arms.{name}", "mounted_on", arm.mounted_on or "nothing", allowed)
    tracked = [f"bodies/{name}/pose" for name in scene.bodies]
    if scene.mode == "lockstep" and hand.tracked not in ("", *tracked):  # each tick waits for it
        allowed = f"in lockstep a body of the scene: {', '.join(tracked) or 'it has none'}"
        raise ConfigError(where, "hand.tracked", hand.tracked, allowed)
    for arm in scene.fingers:
        name = arm.prefix.rstrip("/")
        gains = arm.controller.gains
        if arm.controller.adapt or any(one is None or any(one) for one in (gains.k_p, gains.k_d)):
            allowed = "adapt: false and gains of 0 for the fingers of a hand, which it moves by pressure"
            raise ConfigError(f"{where}: arms.{name}", "controller", "a feedback", allowed)
        if arm.discretisation != scene.fingers[0].discretisation:
            raise ConfigError(f"{where}: arms.{name}", "model", "another model", "the same for all fingers")


def _merged(keys: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """Return keys with own ones in their place, section by section; one with a `kind` stands alone."""

    def value(key: str) -> Any:
        before, after = keys.get(key), own[key]
        if isinstance(before, dict) and isinstance(after, dict) and "kind" not in after:
            return _merged(before, after)
        return after

    return keys | {key: value(key) for key in own}


def _find_files(data: dict[str, Any], folder: Path) -> None:
    """Find the files that a scene or one of its arms names in a folder; read that of the controller.

    The file of a law stands beside the file that names it.
    """
    twin: Any = data.get("twin")
    if isinstance(twin, dict):
        data["twin"] = twin = dict(twin)
    for section, key in ((data, "robot"), (data, "platform"), (data, "controller"), (twin, "plant")):
        name = section.get(key) if isinstance(section, dict) else None
        if isinstance(name, str) and Path(name).suffix and (folder / name).is_file():
            section[key] = str((folder / name).absolute())
    if "bodies" in data:
        find_shapes(data["bodies"], folder)
    beside = folder
    if isinstance(name := data.get("controller"), str):
        file = find_config(name, "controllers")
        data["controller"], beside = read_yaml(file), file.parent
    if isinstance(control := data.get("controller"), dict) and isinstance(law := control.get("law"), str):
        data["controller"] = control | {"law": with_folder(law, beside)}
    arms = data.get("arms")
    for keys in arms.values() if isinstance(arms, dict) else ():
        if isinstance(keys, dict):
            _find_files(keys, folder)


def _set(data: dict[str, Any], key: str, value: Any, where: str) -> None:
    *parents, leaf = key.split(".")
    for parent in parents:
        inner = data.setdefault(parent, {})
        if not isinstance(inner, dict):
            raise ConfigError(where, key, value, f"{parent} is a value, not a section")
        data = inner
    data[leaf] = value


@dataclass(frozen=True)
class Listing:
    """The YAML files of a folder.

    Attributes
    ----------
    scenes : tuple of Scene
        In the order of their files.
    wrong : tuple of str
        A line for each scene that cannot be read.
    others : tuple of str
        The files that are no scenes, and why.
    """

    scenes: tuple[Scene, ...]
    wrong: tuple[str, ...]
    others: tuple[str, ...]


def shipped_folder() -> Path:
    """Folder of the shipped scenes."""
    return config_folder() / "scenes"


def scenes_in(folder: Path) -> Listing:
    """Return the scenes of a folder: the YAML files all of whose keys are those of a scene."""
    scenes, wrong, others = [], [], []
    for file in sorted(folder.glob("*.yaml")):
        try:
            foreign = [key for key in read_yaml(file) if key not in Scene.model_fields]
            if foreign:
                others.append(f"{file.name} (key {foreign[0]})")
                continue
            scenes.append(load_scene(file))
        except ConfigError as error:
            wrong.append(str(error))
    return Listing(tuple(scenes), tuple(wrong), tuple(others))
