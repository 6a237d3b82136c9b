"""`soro view [BAG]`: a running or a recorded arm in the browser."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
import yaml

from soro_core.config import completer_of
from soro_core.errors import BagError, ConfigError
from soro_core.extras import require
from soro_core.files.units import unit_option
from soro_lab.run_folder import run_folders

if TYPE_CHECKING:
    from soro_core.robot import Robot
    from soro_ros.host.services import ServiceCaller
    from soro_ros.view.moment import Moment

PORT = 8080
# Time in which the nodes of a given namespace are found [s].
_FIND_S = 1.0


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
    from soro_ros.nodes.viewer import NICE, run_viewers

    arms = _running(f"/{namespace.strip('/')}" if namespace else "", robot)
    with tempfile.TemporaryDirectory(prefix="soro-") as folder:
        file = Path(folder) / "viewer.yaml"
        entries = {f"{arm}/viewer": {"ros__parameters": {**used, **options}} for arm, used in arms}
        file.write_text(yaml.safe_dump(entries), encoding="utf-8")
        os.nice(NICE)
        run_viewers([arm or "/" for arm, _ in arms], ["--ros-args", "--params-file", str(file)])


def _running(namespace: str, robot: str) -> list[tuple[str, dict[str, str]]]:
    """Return namespace, robot and bodies of each arm that runs, as far as they are not given.

    The bodies are drawn with the first arm alone.

    The arms of a scene are those whose namespaces stand below one, or whose valves one node drives.
    """
    from soro_ros.commands.services import READINGS, one_node, service_caller
    from soro_ros.topics.twin_topics import CONTACTS

    if namespace and robot:
        return [(namespace, {"robot": robot})]
    with service_caller() as caller:
        if namespace:
            within = namespace
            caller.spin(_FIND_S)
        else:
            drivers = [name for new in caller.search("vent", "", 4.0, READINGS) for name in new]
            runs = {name.split("/")[1] if name.count("/") > 2 else name for name in drivers}
            if len(runs) != 1:
                one_node(caller, "vent", "", 4.0, READINGS)  # says why
            within = drivers[0].rpartition("/")[0] if len(drivers) == 1 else f"/{runs.pop()}"
        topics = [name for name, _ in caller.node.get_topic_names_and_types()]
        arms = [name.removesuffix(f"/{READINGS}") for name in topics if name.endswith(f"/{READINGS}")]
        below = sorted(name for name in arms if name.startswith(f"{within}/"))
        found = below if within and within not in arms and below else [within]
        robots = [(arm, {"robot": robot or _robot_of(caller, arm)}) for arm in found]
        if len(found) > 1 or f"{found[0]}/{CONTACTS}" in topics:  # those of the scene, not of one of its arms
            robots[0][1]["bodies_file"] = _parameter_of(caller, found[0], ("twin",), "bodies_file") or ""
        return robots


def _robot_of(caller: ServiceCaller, arm: str) -> str:
    """Return the robot of a running arm, by one of its nodes."""
    found = _parameter_of(caller, arm, ("estimator", "controller", "twin"), "robot")
    if found is None:
        raise ConfigError("soro view", "--robot", None, "given, as no node of the arm has a robot")
    return found


def _parameter_of(caller: ServiceCaller, arm: str, nodes: Sequence[str], name: str) -> str | None:
    """Return a parameter of the first node of an arm that runs; None without one."""
    from rcl_interfaces.srv import GetParameters

    offering = caller.offering("get_parameters")
    known = [f"{arm}/{node}" for node in nodes if f"{arm}/{node}" in offering]
    if not known:
        return None
    request = GetParameters.Request(names=[name])
    answer = caller.call(known[0], "get_parameters", GetParameters, request, 5.0)
    return str(answer.values[0].string_value)


def _recorded(bag: Path, robot: str, namespace: str, port: int, rate: float, trail: float) -> None:
    from soro_core.config import find_config
    from soro_core.robot import load_robot
    from soro_hardware import signals
    from soro_lab.bag import BagReader
    from soro_lab.run_folder import bag_and_scene
    from soro_lab.scene import arm_of, load_scene
    from soro_ros.recordings.bodies.tracks import tracks_of
    from soro_ros.view.access import Access
    from soro_ros.view.moment import PRESSURES
    from soro_ros.view.recorded import RecordedPage, read, shape_of
    from soro_ros.view.server import ViewServer

    def say(line: str) -> None:
        typer.echo(line, err=True)

    arms: dict[str, tuple[Robot, list[Moment]]] = {}
    scene, folder = None, bag
    try:
        folder, scene_file = bag_and_scene(bag)
        scene = load_scene(str(scene_file))
    except BagError:
        with BagReader(bag):  # what is no bag says so itself
            pass
        if not robot:
            raise ConfigError("soro view", "--robot", None, f"given, as {bag} has no scene") from None
    with signals.noted() as ended:
        if scene is None or robot:
            namespace = namespace or (scene.name if scene is not None else "")
            arms[""] = load_robot(find_config(robot, "robots")), read(folder, namespace, None, rate, say)
        else:
            for arm in [arm_of(scene, namespace, "soro view")] if namespace and scene.arms else scene.each:
                at, shape = arm.loaded_robot, shape_of(arm.loaded_robot, arm.discretisation)
                own = arm.name if scene.arms else namespace or arm.name
                arms[arm.prefix.rstrip("/")] = at, read(folder, own, shape, rate, say)
        mounts = {name: on for name, on in scene.mounts.items() if on in arms} if scene is not None else {}
        zero = f"/{scene.each[0].name}/{PRESSURES}" if scene is not None else ""
        bodies = tracks_of(folder, scene, zero) if scene is not None else {}
        access = Access()
        server = ViewServer(access, port)
        try:
            player = RecordedPage(server, arms, trail, bodies, mounts)
            typer.echo(f"view: {access.address(server.get_port())}")
            player.run(lambda: bool(ended))
        finally:
            server.stop()
