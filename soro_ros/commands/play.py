"""`soro play BAG`: publish a recording again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from soro_core.files.units import unit_option
from soro_lab.run_folder import run_folders


def play(
    bag: Annotated[
        Path,
        typer.Argument(
            help="Folder of a bag (rosbag2) or of a run, or a single .mcap or .db3 file.",
            exists=True,
            show_default=False,
            autocompletion=run_folders,
        ),
    ],
    rate: Annotated[
        float, typer.Option(help="Times faster than recorded; 0: as fast as the readers take it.")
    ] = 1.0,
    start: Annotated[
        float, unit_option("--start", "s", 0.0, example="0s", help="Offset into the bag at which to begin.")
    ] = 0.0,
    duration: Annotated[
        float, unit_option("--duration", "s", 0.0, example="0s", help="Recorded time to play; 0: to the end.")
    ] = 0.0,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            "-t",
            metavar="NAME",
            help="Play only this topic or pattern ('/arm/*'); repeatable. Commands are played only so.",
        ),
    ] = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude", "-x", metavar="NAME", help="Leave out this topic or pattern; repeatable."),
    ] = None,
    remap: Annotated[
        list[str] | None,
        typer.Option(
            "--remap", "-r", metavar="OLD:=NEW", help="Publish a topic under another name; repeatable."
        ),
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end, until Ctrl-C.")] = False,
    clock: Annotated[bool, typer.Option("--clock", help="Publish /clock with the recorded time.")] = False,
    wait: Annotated[
        bool, typer.Option("--wait", help="Begin when every topic has a subscriber (at most 30 s).")
    ] = False,
    paused: Annotated[bool, typer.Option("--paused", help="Begin paused; the space key goes on.")] = False,
) -> None:
    """Publish the messages of BAG again, byte for byte, with their types and quality of service.

    A type that was defined otherwise when it was recorded is converted field by field. Topics whose fields do
    not fit, or whose type is not installed, are named and left out. So are topics that end in
    /chambers/command or /chambers/commands, which would drive valves, unless --topic names or matches them.

    Keys: space pauses and goes on, left and right seek by 5 s, up and down double and halve the rate, l
    switches the loop, q ends. From elsewhere: services ~/pause, ~/resume and ~/toggle_paused of the node
    player, and its parameters rate, start_s (to go on from there) and loop.
    """
    # Imported here so that `soro --help` works without ROS.
    from soro_core.config import parse
    from soro_lab.bag import BagReader
    from soro_lab.bag.config import PlayerConfig
    from soro_ros.nodes.player import Player
    from soro_ros.process.node_process import run_node
    from soro_ros.process.parameters import overrides

    options: dict[str, Any] = {
        "bag": str(bag),
        "rate": float(rate),
        "start_s": float(start),
        "duration_s": float(duration),
        "topics": tuple(topic or ()),
        "exclude": tuple(exclude or ()),
        "remap": tuple(remap or ()),
        "loop": loop,
        "clock": clock,
        "wait_for_subscribers": wait,
        "paused": paused,
        "keyboard": True,
        "end_on_failed_start": True,
    }
    config = parse(options, PlayerConfig, where="soro play")
    with BagReader(bag) as reader:
        reader.check_encodings()
    arguments = ["--ros-args"]
    for name, value in overrides(config).items():
        # JSON is YAML with unmistakable quotes.
        arguments += ["-p", f"{name}:={json.dumps(value, ensure_ascii=False)}"]
    run_node(Player, arguments)
