"""The model chosen for a scene and a requirement: stored after a study, used by `model: auto`."""

from __future__ import annotations

from soro_core.errors import ConfigError
from soro_lab.scene import ModelSection, Requirement, Scene
from soro_lab.trade.cache import Cache, choice_key
from soro_lab.trade.candidate import Candidate


def keep_choice(scene: Scene, requirement: Requirement, candidate: Candidate, cache: Cache) -> None:
    """Store the choice of a study.

    Parameters
    ----------
    scene : Scene
    requirement : Requirement
        Required error or time.
    candidate : Candidate
        Chosen candidate.
    cache : Cache
        Where to store it.
    """
    cache.put(_key(scene, requirement), candidate.section)


def with_chosen_model(scene: Scene, cache: Cache | None = None, called: str = "") -> Scene:
    """Return the scene with the choice of `soro trade` in place of `model: auto`.

    Parameters
    ----------
    scene : Scene
    cache : Cache, optional
        Where choices are stored; the user's cache by default.
    called : str
        Name or path of the scene in the advice of the error; the scene's name by default.

    Raises
    ------
    ConfigError
        If there is no choice for this robot, scene and requirement on this machine.
    """
    if scene.model is None or not scene.model.auto:
        return scene
    found = (cache or Cache()).get(_key(scene, scene.model.requirement))
    if found is None:
        name = called or scene.name or "SCENE"
        raise ConfigError(
            name,
            "model",
            "auto, and no measured choice for it",
            f"run first: soro trade {name} {scene.model.requirement.options}",
        )
    return scene.with_keys(model=ModelSection.model_validate(found))


def _key(scene: Scene, requirement: Requirement) -> str:
    return choice_key(scene, scene.loaded_robot.model_dump(mode="json"), str(requirement))
