"""`soro gains SCENE`: the numbers that estimator and controller of a scene use, automatic ones among them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer
import yaml

from soro_core.scene import check_gains, load_scene
from soro_ros.commands.run import SCENE_HELP, given_keys

if TYPE_CHECKING:
    from soro_core.loop import Loop


def gains(
    scene: Annotated[str, typer.Argument(help=SCENE_HELP)],
    change: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the scene.")
    ] = None,
) -> None:
    """Print gains, delays and noise as they are used, as YAML.

    What the scene does not state comes from the model of the robot and from the platform.
    """
    from soro_core.loop import loop_of

    loaded = load_scene(scene, given_keys(change or []))
    check_gains(loaded, loaded.loaded_robot, scene)
    typer.echo(yaml.safe_dump(used_values(loop_of(loaded)), sort_keys=False), nl=False)


def used_values(loop: Loop) -> dict[str, Any]:
    """Return the numbers of feedback, set points, law and filter of a loop, gains by coordinate."""
    from soro_core.control.laws.composite import Composite

    controller, names = loop.controller, loop.controller.robot.coordinate_names

    def by_name(values: Any) -> dict[str, float]:
        return {name: float(f"{value:.4g}") for name, value in zip(names, values, strict=True)}

    feedback = controller.gains
    law = controller.law
    options = law.learner.config.model_dump() if isinstance(law, Composite) else {}
    return {
        "gains": {
            "k_p": by_name(feedback.k_p.diagonal()),
            "k_d": by_name(feedback.k_d.diagonal()),
            "lambda_per_s": by_name(feedback.rate),
        },
        "pressures": controller.pressures.model_dump(mode="json"),
        "law_options": options,
        "estimator": loop.estimator.config.model_dump(mode="json"),
    }
