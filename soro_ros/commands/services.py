"""`soro vent`, `reset`, `enable`, `fault`: services of running nodes, where there is no `ros2` command."""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from soro_core.errors import ConfigError, SoroError
from soro_core.files.units import unit_option
from soro_hardware import signals

if TYPE_CHECKING:
    from soro_ros.host.services import Call, ServiceCaller

# The node that drives the valves publishes pressures. A controller has the same services, but no latch.
READINGS = "chambers/state"
COMMANDS = "chambers/command"
# Advice if no node offers a service.
_RUNNING = "start soro_regulator (or soro run) in this domain, or set ROS_DOMAIN_ID to that of yours"
_START = {
    "reset": _RUNNING,
    "vent": _RUNNING,
    "enable": "start soro_controller in this domain, or set ROS_DOMAIN_ID to that of yours",
    "close": "run a scene with a hand in this domain, soro run grasp_ball",
    "clear_faults": "a twin takes faults in soro run on emulated valves, or with its parameter fault_link",
}
# /diagnostics come once a second.
_STATUS_LIMIT_S = 2.5

_NODE = typer.Argument(
    metavar="NODE",
    help="Full name of the node, /track_circle/regulator, which is found sooner, or its end.",
    show_default=False,
)


def _timeout(default: str) -> Any:
    text = "Longest wait for an answer; nodes are searched for 4 s at most."
    return unit_option("--timeout", "s", 0.1, 600.0, default, help=text)


def reset(
    node: Annotated[str, _NODE] = "",
    timeout_s: Annotated[float, _timeout("20s")] = 20.0,
) -> None:
    """Print why an arm is vented, and open its latch.

    The node that commands the valves (soro_regulator, or soro_twin in its place) refuses while a program
    commands pressure: `soro vent` makes controllers command zero, `soro enable` starts them again after the
    reset. If devices were lost, the reset first repeats their start-up, which may take some seconds.

    Without NODE it is the only node that drives valves. Exit status 1 when it refuses. ROS_DOMAIN_ID must be
    that of the node.
    """
    from std_srvs.srv import Trigger

    with service_caller() as caller:
        from soro_core.safety.state import MUST_BE_ZERO
        from soro_ros.status_words import VENTED

        name = one_node(caller, "reset", node, timeout_s, "" if node else READINGS)
        status = caller.message_of(name, _STATUS_LIMIT_S)
        typer.echo(f"{name}: {status or 'no message on /diagnostics'}")
        if status and not status.startswith(VENTED) and name in caller.offering("reset", READINGS):
            typer.echo(f"{name}: not latched, nothing to reset")
            return
        answer = caller.call(name, "reset", Trigger, Trigger.Request(), timeout_s)
    if not answer.success:
        zero = ": `soro vent` makes controllers command zero" if MUST_BE_ZERO in answer.message else ""
        raise SoroError(f"{name} refuses: {answer.message}{zero}")
    typer.echo(f"{name}: {answer.message}")


def vent(
    node: Annotated[str, _NODE] = "",
    timeout_s: Annotated[float, _timeout("5s")] = 5.0,
) -> None:
    """Vent at once: every node of this ROS domain that has a `~/vent`, or only NODE.

    The node that commands the valves vents and latches until `soro reset`; a controller commands zero until
    `soro enable`. Each vents as soon as it is found, which takes up to 4 s. This is no emergency stop, which
    needs a dump valve.

    Exit status 1 when one of them does not answer, or none is found.
    """
    from std_srvs.srv import Trigger

    with service_caller() as caller:
        calls: dict[str, Call] = {}
        failed: list[str] = []

        def report_answers() -> None:
            for name in [name for name, one in calls.items() if one.done()]:
                answer = calls.pop(name).response
                typer.echo(f"{name}: {answer.message}")
                if not answer.success:
                    failed.append(name)

        # In parallel: a node that does not answer does not delay the others.
        deadline, found, has_driver = time.monotonic() + timeout_s, list[str](), False
        for new in caller.search("vent", node, timeout_s):
            found += new
            # Before the request is sent: it may end the run, and the node with it.
            has_driver = has_driver or not set(found).isdisjoint(caller.offering("vent", READINGS))
            calls |= {name: caller.begin(name, "vent", Trigger, Trigger.Request()) for name in new}
            report_answers()
        while calls and time.monotonic() < deadline:
            caller.spin(0.02)
            report_answers()
        if not found:
            raise _none(caller, "vent", node)
        for name, one in calls.items():
            typer.echo(f"{name}: {one.failure(timeout_s)}: does its process run?", err=True)
        if not (node or has_driver or caller.offering("vent", READINGS)):
            # After the driver was killed, a controller may still report success.
            raise SoroError(f"no node in {caller.domain} drives the valves, so none was vented; {_RUNNING}")
    if calls or failed:
        raise typer.Exit(1)


def enable(
    node: Annotated[str, _NODE] = "",
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Only warn of a pose or a pressure that does not fit.")
    ] = False,
    timeout_s: Annotated[float, _timeout("5s")] = 5.0,
) -> None:
    """Start the commands of a controller, at its start and after `soro vent`.

    The controller first checks that its samples are fresh, that no chamber is under pressure, and that the
    sensors agree with the model at rest (docs/motion.md; keys check_at_enable and enable of its file). Exit
    status 1 when it refuses.

    Without NODE it is the only controller. The node that commands the valves needs no such call; while it is
    vented the controller refuses: the order is `soro vent`, `soro reset`, `soro enable`.
    """
    from std_srvs.srv import Trigger

    with service_caller() as caller:
        from soro_ros.status_words import VENTED

        name = one_node(caller, "enable", node, timeout_s, "" if node else COMMANDS)
        service = "enable_anyway" if anyway else "enable"
        answer = caller.call(name, service, Trigger, Trigger.Request(), timeout_s)
        if not answer.success:
            raise SoroError(f"{name} refuses: {answer.message}")
        typer.echo(f"{name}: {answer.message}")
        namespace = name.rpartition("/")[0]
        for driver in caller.offering("reset", READINGS):
            is_of_arm = driver.rpartition("/")[0] == namespace
            if is_of_arm and caller.message_of(driver, _STATUS_LIMIT_S).startswith(VENTED):
                typer.echo(f"{driver}: still vented: `soro vent`, `soro reset`, `soro enable`", err=True)


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
    timeout_s: Annotated[float, _timeout("5s")] = 5.0,
) -> None:
    """Inject a fault into emulated valves while they run, or end all faults.

    NODE is the twin of a run on emulated valves, or the socket that `soro emulate --control` listens on. The
    words are those of docs/safety.md; a wrong one is answered with all of them, and exit status 1.
    """
    if (injection is None) == (not clear):
        raise ConfigError("soro fault", "FAULT", injection, "a fault, or --clear, and not both")
    from soro_hardware.emulation.faults.fault_types import CLEAR
    from soro_hardware.emulation.sockets.control import ControlClient

    text = f"fault: {CLEAR}" if injection is None else injection
    if _is_path(node):
        with contextlib.closing(ControlClient(node)) as client:
            typer.echo(f"{node}: {client.inject(text)}")
        return
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    from soro_ros.run.faults import PARAMETER

    with service_caller() as caller:
        name = one_node(caller, "clear_faults", node, timeout_s)
        request = SetParameters.Request(parameters=[Parameter(PARAMETER, value=text).to_parameter_msg()])
        (answer,) = caller.call(name, "set_parameters", SetParameters, request, timeout_s).results
    if not answer.successful:
        raise SoroError(f"{name} refuses: {answer.reason}")
    typer.echo(f"{name}: {'no faults' if clear else f'injected {text}'}")


def _is_path(name: str) -> bool:
    """Whether a name is a socket and not a node: the file exists, or no node can have this name."""
    path = Path(name)
    in_a_folder = path.is_absolute() and len(path.parts) > 2 and path.parent.is_dir()
    is_there = path.exists() and not path.is_dir()
    return is_there or in_a_folder or re.search(r"[^A-Za-z0-9_/]", name) is not None


@contextlib.contextmanager
def service_caller() -> Iterator[ServiceCaller]:
    """Join ROS for some calls; Ctrl-C ends them with exit status 130."""
    with signals.noted() as stopping:
        from soro_ros.host.services import ServiceCaller

        try:
            with ServiceCaller(lambda: len(stopping)) as caller:
                yield caller
        except KeyboardInterrupt:
            typer.echo("soro: interrupted", err=True)
            raise typer.Exit(130) from None


def one_node(caller: ServiceCaller, service: str, wanted: str, limit_s: float, publishing: str = "") -> str:
    """Return the node with this name or end of a name; an error lists the candidates.

    Parameters
    ----------
    caller : ServiceCaller
    service : str
        Service that the node offers.
    wanted : str
        Full name of the node or its end; "" for any.
    limit_s : float
        Time limit of the search [s].
    publishing : str
        Ending of a topic that the node publishes; "" for any.

    Raises
    ------
    SoroError
        If there is none, or more than one.
    """
    found = [name for new in caller.search(service, wanted, limit_s, publishing) for name in new]
    if not found:
        raise _none(caller, service, wanted, publishing)
    if len(found) > 1:
        known = [f"{name} ({caller.message_of(name, _STATUS_LIMIT_S) or 'no message'})" for name in found]
        raise ConfigError(f"soro {service}", "NODE", wanted, f"one of {', '.join(known)}")
    return found[0]


def _none(caller: ServiceCaller, service: str, wanted: str, publishing: str = "") -> SoroError:
    """Return the error for a search without result."""
    others = [name for name in caller.offering(service) if wanted]
    if publishing == COMMANDS and not wanted and not caller.offering(service):
        return SoroError(f"no arm is running in {caller.domain}: soro run SCENE starts one")
    missing = f"no node {wanted}" if others else f"no node with a service ~/{service}"
    if publishing:
        missing += f" that publishes {publishing}"
    do = f"there is {', '.join(others)}" if others else _START[service]
    return SoroError(f"{missing} in {caller.domain}: {do}")
