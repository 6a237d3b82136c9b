"""`soro vent`, `reset`, `enable`, `fault`: services of running nodes, where there is no `ros2` command."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soro_core.errors import ConfigError, SoroError
from soro_ros import signals

if TYPE_CHECKING:
    from soro_ros.services import Call, Visitor

# Who holds the air publishes its pressures. A controller offers the same services and has no latch.
_READINGS = "chambers/state"
_COMMANDS = "chambers/command"
# What to do where nobody offers a service.
_RUNNING = "start soro_regulator (or soro run) in this domain, or set ROS_DOMAIN_ID to that of yours"
_START = {
    "reset": _RUNNING,
    "vent": _RUNNING,
    "enable": "start soro_controller in this domain, or set ROS_DOMAIN_ID to that of yours",
    "clear_faults": "a twin takes faults in soro run on emulated valves, or with its parameter fault_link",
}
# /diagnostics come once a second.
_HEARD_S = 2.5

_NODE = typer.Argument(
    metavar="NODE",
    help="Full name of the node, /track_circle/regulator, which is found sooner, or its end.",
    show_default=False,
)
_TIMEOUT = typer.Option(
    "--timeout-s",
    min=0.1,
    max=600.0,
    help="Longest wait for an answer [s]; nodes are searched for 4 s at most.",
)


def reset(
    node: Annotated[str, _NODE] = "",
    timeout_s: Annotated[float, _TIMEOUT] = 20.0,
) -> None:
    """Open the latch of a vented arm, after saying what closed it.

    The node that holds the air (soro_regulator, or soro_twin in its place) refuses while somebody commands
    pressure: `soro vent` makes controllers command zero, `soro enable` starts them again after the reset. It
    takes its devices through their start-up again where they were lost, which may need some seconds.

    Without NODE it is the only one that holds air. Exit status 1 when it refuses. ROS_DOMAIN_ID must be that
    of the node.
    """
    from std_srvs.srv import Trigger

    with _visiting() as visitor:
        name = _one(visitor, "reset", node, timeout_s, "" if node else _READINGS)
        said = visitor.says(name, _HEARD_S)
        typer.echo(f"{name}: {said or 'nothing heard of it on /diagnostics'}")
        if said and not said.startswith("vented") and name in visitor.offering("reset", _READINGS):
            typer.echo(f"{name}: not latched, nothing to reset")
            return
        answer = visitor.call(name, "reset", Trigger, Trigger.Request(), timeout_s)
    if not answer.success:
        zero = ": `soro vent` makes controllers command zero" if "must be zero" in answer.message else ""
        raise SoroError(f"{name} refuses: {answer.message}{zero}")
    typer.echo(f"{name}: {answer.message}")


def vent(
    node: Annotated[str, _NODE] = "",
    timeout_s: Annotated[float, _TIMEOUT] = 5.0,
) -> None:
    """Vent at once: every node of this ROS domain that has a `~/vent`, or only NODE.

    What holds the air vents and latches until `soro reset`; a controller commands zero until `soro enable`.
    Each vents as soon as it is found, which takes up to 4 s. Not an emergency stop: that is a dump valve.

    Exit status 1 when one of them does not answer, or none is found.
    """
    from std_srvs.srv import Trigger

    with _visiting() as visitor:
        calls: dict[str, Call] = {}
        failed: list[str] = []

        def take() -> None:
            for name in [name for name, one in calls.items() if one.done()]:
                answer = calls.pop(name).response
                typer.echo(f"{name}: {answer.message}")
                if not answer.success:
                    failed.append(name)

        # Side by side: one that does not answer keeps nobody else waiting.
        deadline, found, holds = time.monotonic() + timeout_s, list[str](), False
        for new in visitor.search("vent", node, timeout_s):
            found += new
            calls |= {name: visitor.begin(name, "vent", Trigger, Trigger.Request()) for name in new}
            take()
            # While it is there: a run ends because of this.
            holds = holds or not set(found).isdisjoint(visitor.offering("vent", _READINGS))
        while calls and time.monotonic() < deadline:
            visitor.spin(0.02)
            take()
        if not found:
            raise _none(visitor, "vent", node)
        for name, one in calls.items():
            typer.echo(f"{name}: {one.trouble(timeout_s)}: is its process alive?", err=True)
        if not (node or holds or visitor.offering("vent", _READINGS)):
            # After the driver was killed a controller may say that all is well.
            raise SoroError(f"nobody in {visitor.domain} holds the air: no valve was told; {_RUNNING}")
    if calls or failed:
        raise typer.Exit(1)


def enable(
    node: Annotated[str, _NODE] = "",
    timeout_s: Annotated[float, _TIMEOUT] = 5.0,
) -> None:
    """Let a controller command, at its start and after `soro vent`.

    Without NODE it is the only controller there is. What holds the air needs no such call; it has to be reset
    first where it is latched.
    """
    from std_srvs.srv import Trigger

    with _visiting() as visitor:
        name = _one(visitor, "enable", node, timeout_s, "" if node else _COMMANDS)
        answer = visitor.call(name, "enable", Trigger, Trigger.Request(), timeout_s)
    if not answer.success:
        raise SoroError(f"{name} refuses: {answer.message}")
    typer.echo(f"{name}: {answer.message}")


def fault(
    node: Annotated[
        str,
        typer.Argument(
            help="Name of the twin, /track_circle/twin or its end; or the socket of `soro emulate`."
        ),
    ],
    injection: Annotated[
        str | None,
        typer.Argument(metavar="FAULT", help="As YAML, 'fault: mute, chamber: link0/chamber2'."),
    ] = None,
    clear: Annotated[bool, typer.Option("--clear", help="End all faults instead.")] = False,
    timeout_s: Annotated[float, _TIMEOUT] = 5.0,
) -> None:
    """Inject a fault into emulated valves while they run, or end all faults.

    NODE is the twin of a run on emulated valves, or the socket that `soro emulate --control` listens on. The
    words are those of docs/safety.md; a wrong one is answered with all of them, and exit status 1.
    """
    if (injection is None) == (not clear):
        raise ConfigError("soro fault", "FAULT", injection, "a fault, or --clear, and not both")
    from soro_core.hardware.emulation.control import ControlClient
    from soro_core.hardware.emulation.faults import CLEAR

    text = f"fault: {CLEAR}" if injection is None else injection
    if _is_path(node):
        with contextlib.closing(ControlClient(node)) as client:
            typer.echo(f"{node}: {client.inject(text)}")
        return
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    from soro_ros.faults import PARAMETER

    with _visiting() as visitor:
        name = _one(visitor, "clear_faults", node, timeout_s)
        request = SetParameters.Request(parameters=[Parameter(PARAMETER, value=text).to_parameter_msg()])
        (answer,) = visitor.call(name, "set_parameters", SetParameters, request, timeout_s).results
    if not answer.successful:
        raise SoroError(f"{name} refuses: {answer.reason}")
    typer.echo(f"{name}: {'no faults' if clear else f'injected {text}'}")


def _is_path(name: str) -> bool:
    """Whether it is meant for a socket and not for a node: it is there, or cannot be a node's name."""
    path = Path(name)
    in_a_folder = path.is_absolute() and len(path.parts) > 2 and path.parent.is_dir()
    is_there = path.exists() and not path.is_dir()
    return is_there or in_a_folder or re.search(r"[^A-Za-z0-9_/]", name) is not None


@contextlib.contextmanager
def _visiting() -> Iterator[Visitor]:
    """Join ROS as a visitor; a Ctrl-C at any moment ends it with exit status 130."""
    with signals.noted() as stopping:
        from soro_ros.services import Visitor

        try:
            with Visitor(lambda: bool(stopping)) as visitor:
                yield visitor
        except KeyboardInterrupt:
            typer.echo("soro: interrupted", err=True)
            raise typer.Exit(130) from None


def _one(visitor: Visitor, service: str, wanted: str, limit_s: float, publishing: str = "") -> str:
    """The one node that is meant; an error lists those that it could be."""
    found = [name for new in visitor.search(service, wanted, limit_s, publishing) for name in new]
    if not found:
        raise _none(visitor, service, wanted, publishing)
    if len(found) > 1:
        said = [f"{name} ({visitor.says(name, _HEARD_S) or 'nothing heard of it'})" for name in found]
        raise ConfigError(f"soro {service}", "NODE", wanted, f"one of {', '.join(said)}")
    return found[0]


def _none(visitor: Visitor, service: str, wanted: str, publishing: str = "") -> SoroError:
    """Why nobody was found."""
    others = [name for name in visitor.offering(service) if wanted]
    missing = f"no node {wanted}" if others else f"no node with a service ~/{service}"
    if publishing:
        missing += f" that publishes {publishing}"
    do = f"there is {', '.join(others)}" if others else _START[service]
    return SoroError(f"{missing} in {visitor.domain}: {do}")
