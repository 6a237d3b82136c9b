"""`soro grasp`: the hand of a running scene closes, squeezes until it holds, and opens."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from soro_core.errors import ConfigError
from soro_core.files.units import unit_option
from soro_ros.commands.services import one_node, service_caller


class GraspAction(StrEnum):
    """What a hand is asked for."""

    HOLD = "hold"
    KEEP = "keep"
    OPEN = "open"


def grasp(
    action: Annotated[
        GraspAction,
        typer.Argument(
            help="hold: for a time, then open. keep: end while it holds. open: only open the hand."
        ),
    ] = GraspAction.HOLD,
    duration_s: Annotated[
        float,
        unit_option("--duration", "s", 0.0, 3600.0, "5s", help="How long it holds before it opens."),
    ] = 5.0,
    force: Annotated[
        float | None,
        unit_option("--force", "N", 1e-6, 1e3, help="First squeeze of each finger, also later."),
    ] = None,
    crush: Annotated[
        float | None,
        unit_option("--crush", "N", 1e-6, 1e3, help="Largest force of a finger, by estimate, also later."),
    ] = None,
    node: Annotated[str, typer.Option(help="Hand, by its full name or its end; default: the only one.")] = "",
    timeout_s: Annotated[
        float,
        unit_option(
            "--timeout", "s", 0.1, 600.0, "10s", help="Longest wait for a node, an answer or progress."
        ),
    ] = 10.0,
) -> None:
    """Close the hand of a running scene, squeeze until it holds, hold, and open.

    Each finger closes until it touches; all squeeze together by `--force`, and harder while the object slips
    (docs/bodies.md). The lines say when it slips, and when it is at the crush limit.

    Exit status 0: the object was held for the duration. 1: a finger met nothing, the object was lost, or the
    hand was vented. 2: it was refused before anything moved. Ctrl-C opens, and the last line says so.
    """
    if action is GraspAction.OPEN and (force is not None or crush is not None):
        raise ConfigError("soro grasp", "open", "a force", "open alone")
    with service_caller() as caller:
        from soro_ros.run.grasp_client import Grasper

        name = one_node(caller, "close", node, timeout_s, "hand/grasp")
        grasper = Grasper(caller, name, timeout_s, typer.echo)
        if action is GraspAction.OPEN:
            raise typer.Exit(grasper.open())
        with grasper.configured({"squeeze.force_n": force, "squeeze.crush_n": crush}):
            status = grasper.grasp(None if action is GraspAction.KEEP else duration_s)
    raise typer.Exit(status)
