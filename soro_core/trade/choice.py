"""The model that was chosen for a scene and a wish: kept after a study, taken by `model: auto`."""

from __future__ import annotations

from soro_core.config import find_config
from soro_core.errors import ConfigError
from soro_core.robot import load_robot
from soro_core.scene import ModelSection, Scene, Wish
from soro_core.trade.cache import Cache, choice_key
from soro_core.trade.candidate import Candidate


def keep_choice(scene: Scene, wish: Wish, candidate: Candidate, cache: Cache) -> None:
    """Remember what a study has chosen."""
    cache.put(_key(scene, wish), candidate.section)


def with_chosen_model(scene: Scene, cache: Cache | None = None, called: str = "") -> Scene:
    """Return the scene with its model stated: what `soro trade` chose where it says auto.

    `called` is the name or path that the error tells to run `soro trade` with; default the scene's name.

    Raises
    ------
    ConfigError
        If nothing was chosen yet for this robot, scene and wish on this machine.
    """
    if scene.model is None or not scene.model.auto:
        return scene
    found = (cache or Cache()).get(_key(scene, scene.model.wish))
    if found is None:
        name = called or scene.name or "SCENE"
        raise ConfigError(
            name,
            "model",
            "auto, and no measured choice for it",
            f"run first: soro trade {name} {scene.model.wish.options}",
        )
    return scene.model_copy(update={"model": ModelSection.model_validate(found)})


def _key(scene: Scene, wish: Wish) -> str:
    robot = load_robot(find_config(scene.robot, "robots")).model_dump(mode="json")
    return choice_key(scene, robot, str(wish))
