"""`soro replay BAG`: a recorded run through the same code again, compared with what was recorded."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from soro_lab.run_folder import bag_and_scene, run_folders
from soro_lab.scene import load_scene
from soro_lab.scene.options import given_keys

if TYPE_CHECKING:
    from soro_ros.recordings.replay import Replayed


def replay(
    bag: Annotated[
        Path,
        typer.Argument(
            help="Folder of a run in lockstep, of its bag, or one of bags/.",
            show_default=False,
            autocompletion=run_folders,
        ),
    ],
    nodes: Annotated[
        str, typer.Option(metavar="NODE,...", help="Nodes to replay: estimator, controller, or both.")
    ] = "estimator,controller",
    tolerance: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="Allowed difference of a number, as a part of its largest recorded magnitude; 0: equal to "
            "the bit, as on the machine that recorded it.",
        ),
    ] = 1e-5,
    ignore: Annotated[
        list[str] | None,
        typer.Option(
            "--ignore",
            "-i",
            metavar="FIELD",
            help="Topic or field that is not compared, arm/tip or arm/tip.pose.covariance, or a pattern; "
            "repeatable.",
        ),
    ] = None,
    scene: Annotated[
        Path | None, typer.Option(help="Scene of the run; default: the one in its folder.", exists=True)
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the scene, to see what it changes."),
    ] = None,
) -> None:
    """Feed a recorded run through estimator and controller, and compare each field that they publish.

    The nodes' own code runs in lockstep in this process, without ROS nodes; each takes its recorded inputs.
    Exit status 0: the same; 1: different, and the first difference is shown; 2: wrong use.
    """
    from soro_ros.recordings.replay import replay as run  # imports the model, which takes a second

    found, scene_file = (bag, scene) if scene else bag_and_scene(bag)
    result = run(
        found,
        load_scene(scene_file, given_keys(change or [])),
        tuple(name.strip() for name in nodes.split(",")),
        tolerance,
        ignore or (),
    )
    _print(result)
    raise typer.Exit(0 if result.same else 1)


def _print(result: Replayed) -> None:
    console = Console(markup=False, highlight=False)
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("topic", overflow="fold")
    for heading in ("messages", "different", "largest difference"):
        table.add_column(heading, justify="right")
    for topic in result.topics:
        worst = f"{topic.worst:.2g}" if topic.worst else "none"
        table.add_row(topic.topic, str(topic.compared), str(topic.differing), worst)
    console.print(table)
    for name in result.left_out:
        console.print(f"{name}: not recorded, not compared", soft_wrap=True)
    for name in result.without:
        console.print(f"{name}: not recorded; a tick that waits for it is not computed", soft_wrap=True)
    for problem in result.problems:
        console.print(problem, style="yellow", soft_wrap=True)
    firsts = sorted(topic.first for topic in result.topics if topic.first is not None)
    if firsts:
        console.print(f"first difference: {firsts[0]}", soft_wrap=True)
        for other in firsts[1:]:
            console.print(f"            then: {other}", soft_wrap=True)
    else:
        console.print("the same")
