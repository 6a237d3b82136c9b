"""`soro gains SCENE`: the numbers that estimator and controller of a scene use, automatic ones among them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer
import yaml

from soro_core.files.rounded import rounded
from soro_lab.scene import check_gains, load_scene, require_one_arm
from soro_lab.scene.options import Change, SceneName, given_keys

if TYPE_CHECKING:
    from soro_core.loop import Loop


def gains(
    scene: SceneName,
    change: Change = None,
) -> None:
    """Print gains, delays and noise as they are used, as YAML.

    What the scene does not state comes from the model of the robot and from the platform (docs/gains.md).
    Units of elongation and bending: k_p J and J m^2, k_d J s and J m^2 s; of the other keys SI.
    """
    from soro_lab.scene.loop import loop_of

    loaded = require_one_arm(load_scene(scene, given_keys(change or [])), scene)
    check_gains(loaded, loaded.loaded_robot, scene)
    typer.echo(yaml.safe_dump(used_values(loop_of(loaded)), sort_keys=False), nl=False)


def used_values(loop: Loop) -> dict[str, Any]:
    """Return the numbers of feedback, set points, law and filter of a loop, gains by coordinate."""
    from soro_core.control.laws.adaptive import Adaptive
    from soro_core.control.laws.composite import Composite

    controller, names = loop.controller, loop.controller.robot.coordinate_names

    def by_name(values: Any) -> dict[str, Any]:
        return dict(zip(names, values.tolist(), strict=True))

    feedback, law = controller.gains, controller.law
    of_law: dict[str, Any] = {}
    if isinstance(law, Composite):
        of_law = {"law_options": law.learner.config.model_dump()}
    elif isinstance(law, Adaptive):
        of_law = {"adaptation": law.parameters.config.model_dump(mode="json")}
    used = {
        "law": controller.config.law,
        "gains": {
            "k_p": by_name(feedback.k_p.diagonal()),
            "k_d": by_name(feedback.k_d.diagonal()),
            "lambda_per_s": by_name(feedback.rate),
        },
        "pressures": controller.pressures.model_dump(mode="json"),
        **of_law,
        "estimator": loop.estimator.config.model_dump(mode="json"),
    }
    return dict(rounded(used))
