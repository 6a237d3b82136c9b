"""`soro view [BAG]`: a running or a recorded arm in the browser."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from soro_core.config import completer_of
from soro_core.errors import BagError, ConfigError
from soro_core.extras import require
from soro_core.files.units import unit_option
from soro_lab.run_folder import run_folders

PORT = 8080


def view(
    bag: Annotated[
        Path | None,
        typer.Argument(
            help="Folder of a run, of its bag, or one of bags/; without it, the arm that runs.",
            exists=True,
            show_default=False,
            autocompletion=run_folders,
        ),
    ] = None,
    robot: Annotated[
        str,
        typer.Option(
            metavar="ROBOT",
            help="Robot file, or name of a shipped one; default: that of the run.",
            autocompletion=completer_of("robots"),
            show_default=False,
        ),
    ] = "",
    namespace: Annotated[
        str,
        typer.Option(metavar="NAME", help="Namespace of the arm; default: the only one.", show_default=False),
    ] = "",
    port: Annotated[
        int, typer.Option(min=1024, max=65535, help="Port on 127.0.0.1; the next free one if taken.")
    ] = PORT,
    rate: Annotated[float, unit_option("--rate", "Hz", 1.0, 60.0, "20Hz", help="Of the pictures.")] = 20.0,
    trail: Annotated[
        float, unit_option("--trail", "s", 1.0, 120.0, "10s", help="Length of trails and plots.")
    ] = 10.0,
) -> None:
    """Show an arm in the browser: its shape, reference, pressures, faults, and buttons to act on it.

    Prints an address for a browser on this machine, and serves it until Ctrl-C. The token in it gives the
    buttons enable, vent and reset; without it, one may only look. A recorded run can be paused, and has a
    slider over its time.
    """
    require("ros", "view")
    if bag is None:
        _live(robot, namespace, {"port": port, "rate_hz": rate, "trail_s": trail})
    else:
        _recorded(bag, robot, namespace, port, rate, trail)


def _live(robot: str, namespace: str, options: dict[str, int | float]) -> None:
    from soro_ros.nodes.viewer import NICE, Viewer
    from soro_ros.process.node_process import run_node

    found, used = _running(f"/{namespace.strip('/')}" if namespace else "", robot)
    arguments = ["--ros-args", "-r", f"__ns:={found or '/'}", "-p", f"robot:={used}"]
    for name, value in options.items():
        arguments += ["-p", f"{name}:={value}"]
    os.nice(NICE)
    run_node(Viewer, arguments)


def _running(namespace: str, robot: str) -> tuple[str, str]:
    """Return namespace and robot of the arm that runs, as far as they are not given."""
    from rcl_interfaces.srv import GetParameters

    from soro_ros.commands.services import READINGS, one_node, service_caller

    if namespace and robot:
        return namespace, robot
    with service_caller() as caller:
        if not namespace:
            namespace = one_node(caller, "vent", "", 4.0, READINGS).rpartition("/")[0]
        if not robot:
            names = [f"{namespace}/{node}" for node in ("estimator", "controller", "twin")]
            known = [name for name in names if name in caller.offering("get_parameters")]
            if not known:
                raise ConfigError("soro view", "--robot", None, "given, as no node of the arm has a robot")
            request = GetParameters.Request(names=["robot"])
            answer = caller.call(known[0], "get_parameters", GetParameters, request, 5.0)
            robot = answer.values[0].string_value
    return namespace, robot


def _recorded(bag: Path, robot: str, namespace: str, port: int, rate: float, trail: float) -> None:
    from soro_core.config import find_config
    from soro_core.robot import load_robot
    from soro_hardware import signals
    from soro_lab.bag import BagReader
    from soro_lab.run_folder import bag_and_scene
    from soro_lab.scene import load_scene
    from soro_ros.view.access import Access
    from soro_ros.view.recorded import RecordedPage, read, shape_of
    from soro_ros.view.server import ViewServer

    shape, folder = None, bag
    try:
        folder, scene_file = bag_and_scene(bag)
    except BagError:
        with BagReader(bag):  # what is no bag says so itself
            pass
        if not robot:
            raise ConfigError("soro view", "--robot", None, f"given, as {bag} has no scene") from None
    else:
        scene = load_scene(str(scene_file))
        namespace = namespace or scene.name
        if not robot:
            robot = scene.robot
            shape = shape_of(load_robot(find_config(robot, "robots")), scene.discretisation)
    shown = load_robot(find_config(robot, "robots"))
    with signals.noted() as ended:
        recorded = read(folder, namespace, shape, rate, lambda line: typer.echo(line, err=True))
        access = Access()
        server = ViewServer(access, port)
        try:
            player = RecordedPage(server, shown, recorded, trail)
            typer.echo(f"view: {access.address(server.get_port())}")
            player.run(lambda: bool(ended))
        finally:
            server.stop()
