"""Nodes as a process: command line, signals, real-time priority, and an end that vents first."""

from __future__ import annotations

import contextlib
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.exceptions import InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.utilities import try_shutdown

from soro_core.errors import ConfigError, SoroError
from soro_hardware import signals, timing
from soro_ros.host import middleware
from soro_ros.host.claims import Claims
from soro_ros.process import command_line
from soro_ros.process.command_line import Program
from soro_ros.process.lifecycle import Config, SoroNode
from soro_ros.topics.diagnostics import WARN
from soro_ros.topics.intra_process import Handover

RCLError = rclpy_implementation.RCLError

# rclpy's own spin() of the events executor never returns to Python; a bounded wait lets signals through.
SPIN_WAIT_S = 0.1
# Time limit of the middleware's end, after the end of Python [s].
LEAVE_S = 10


def run_node(node_class: type[SoroNode[Config]], args: list[str] | None = None) -> None:
    """Run one node as a process, see `run_nodes`."""
    run_nodes([node_class], command_line.of_node(node_class.node_name, node_class.config_model), args)


def run_nodes(
    node_classes: Sequence[Callable[[], SoroNode[Any]]], program: Program, args: list[str] | None = None
) -> None:
    """Run nodes as one process: exit 0 after a clean end, 2 on a wrong configuration, 1 on a failure.

    A wrong command line ends it at once, a start that fails only with the parameter `end_on_failed_start`.
    SIGINT and SIGTERM are handled here and not by rclpy, whose handler shuts the context down before
    Python runs, so that a safe state could no longer be announced.

    Parameters
    ----------
    node_classes : sequence of callable
        Classes of the nodes, or what else makes them. The last one drives the valves: it is configured last
        and made safe first.
    program : Program
        What its command line says of itself.
    args : list of str, optional
        Arguments; default: those of the process.
    """
    with signals.noted() as stopping:
        status = run_until_end(node_classes, program, args, stopping)
    # The middleware ends after Python. If it hangs then, at real-time priority, the kernel ends the process.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(LEAVE_S)
    raise SystemExit(status)


def run_until_end(
    node_classes: Sequence[Callable[[], SoroNode[Any]]],
    program: Program,
    args: list[str] | None,
    stopping: list[int],
) -> int:
    """Run nodes until one of them finishes or fails, or a signal ends them.

    Parameters
    ----------
    node_classes : sequence of callable
    program : Program
    args : list of str or None
        As in `run_nodes`.
    stopping : list of int
        Signals that end the nodes, see `signals.noted`.

    Returns
    -------
    int
        Exit status, see `run_nodes`.
    """
    nodes: list[SoroNode[Any]] = []
    claims = Claims()
    handover = Handover()
    status = 0
    try:
        command_line.initialise(program, args)
        for node_class in node_classes:
            nodes.append(_make(node_class, claims, program.name))
            nodes[-1].handover = handover
        with signals.raised(stopping):
            _start(nodes, stopping)
        _spin(nodes, stopping, handover)
        status = 2 if _refused(nodes) else 1 if any(node.failure for node in nodes) else 0
    except ConfigError as error:
        print(f"{program.name}: {error}", file=sys.stderr)
        status = 2
    except (ExternalShutdownException, KeyboardInterrupt):
        # A supervisor that reads the failure in /diagnostics may interrupt before the end.
        status = 2 if _refused(nodes) else 0
    finally:
        handover.end()
        for node in reversed(nodes):
            if not _made_safe(node):
                status = status or 1
        for node in reversed(nodes):
            with contextlib.suppress(RCLError):  # an interrupted transition permits no other one
                node.trigger_shutdown()
            node.diagnostics.publish()
            middleware.deliver(node)
            node.destroy_node()
        try_shutdown()
        claims.close()
    return status


def _refused(nodes: Sequence[SoroNode[Any]]) -> bool:
    """Whether a node has refused its configuration."""
    return any(isinstance(node.failure, ConfigError) for node in nodes)


def _made_safe(node: SoroNode[Any]) -> bool:
    try:
        node.make_safe()
    except Exception:  # the steps after it are still necessary
        node.get_logger().error(traceback.format_exc())
        return False
    return True


def _make(node_class: Callable[[], SoroNode[Any]], claims: Claims, name: str) -> SoroNode[Any]:
    try:
        node = node_class()
    except (InvalidParameterValueException, ValueError) as error:
        called = getattr(node_class, "node_name", name)
        raise ConfigError(f"parameters of {called}", "", str(error), "values with a type") from None
    try:
        claims.take(node, node.claims())
    except ConfigError:
        node.destroy_node()  # at once: what it says as it ends would be said under the name of the other
        raise
    return node


def _start(nodes: Sequence[SoroNode[Any]], stopping: list[int]) -> None:
    """Configure all nodes whose `autostart` is true, which may compile, and activate them then.

    If one fails they stay, as others in ROS, unless it is to end then.
    """
    wanted = [node for node in nodes if node.get_parameter_or("autostart").value]
    for node in nodes:
        node.stopping = stopping
    try:
        for step in ("configure", "activate"):
            for node in wanted:
                failed = next((one for one in wanted if one.failure), None)
                if failed is None:
                    getattr(node, f"trigger_{step}")()
                    if node.failure is not None:
                        _stay_or_end(node, step)
                elif node is not failed:
                    node.diagnostics.update(WARN, f"not started: {failed.get_name()} has failed")
                    node.get_logger().warning(f"{failed.get_name()} has failed: no {step} of this node")
    finally:
        for node in nodes:
            node.stopping = []  # later errors are no interrupts


def _stay_or_end(node: SoroNode[Any], step: str) -> None:
    """Say how to try a step of the start again, or end the process."""
    if node.get_parameter_or("end_on_failed_start").value:
        node.finish()
    elif not node.finished:
        again = f"ros2 lifecycle set {node.get_fully_qualified_name()} {step}"
        node.get_logger().info(f"waiting for another try: {again}")


def _spin(nodes: Sequence[SoroNode[Any]], stopping: list[int], handover: Handover) -> None:
    from rclpy.experimental.events_executor import EventsExecutor

    if any(node.finished for node in nodes):
        return
    executor = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    handover.begin(executor)
    timing.shorten_pauses()
    _prioritise(max(nodes, key=lambda node: node.priority))
    failed: Any = nodes[-1]  # the executor does not say whose callback raises
    try:
        while not stopping and not any(node.finished for node in nodes):
            executor.spin_once(timeout_sec=SPIN_WAIT_S)
            if handover.failure is not None:
                failed, error = handover.failure
                raise error
    except SoroError as error:  # raised in a callback
        failed.fail(error)


def _prioritise(node: SoroNode[Any]) -> None:
    """Request a node's priority for the process; without the right to it a warning is logged."""
    if node.priority > 0 and (failure := timing.prioritise(node.priority)):
        node.get_logger().warning(f"no real-time priority ({failure}): see docs/real_time.md")
