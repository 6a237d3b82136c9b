"""A node as a process: command line, signals, real-time priority, and an end that vents first."""

from __future__ import annotations

import contextlib
import signal
import sys
import traceback

import rclpy
from rclpy.exceptions import InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation

from soro_core.errors import ConfigError, SoroError
from soro_ros import command_line, middleware, signals, timing
from soro_ros.lifecycle import Config, SoroNode

RCLError = rclpy_implementation.RCLError

# rclpy's own spin() of the events executor never returns to Python; a bounded wait lets signals through.
SPIN_WAIT_S = 0.1
# Time limit of the middleware's end, after the end of Python [s].
LEAVE_S = 10


def run_node(node_class: type[SoroNode[Config]], args: list[str] | None = None) -> None:
    """Run one node as a process: exit 0 after a clean end, 2 on a wrong configuration, 1 on a failure.

    A wrong command line ends it at once, a start that fails only with the parameter `end_on_failed_start`.
    SIGINT and SIGTERM are handled here and not by rclpy, whose handler shuts the context down before
    Python runs, so that a safe state could no longer be announced.
    """
    with signals.noted() as stopping:
        status = run_until_end(node_class, args, stopping)
    # The middleware ends after Python. If it hangs then, at real-time priority, the kernel ends the process.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(LEAVE_S)
    raise SystemExit(status)


def run_until_end(node_class: type[SoroNode[Config]], args: list[str] | None, stopping: list[int]) -> int:
    """Run one node until it finishes, fails or a signal ends it.

    Parameters
    ----------
    node_class : type
        Class of the node.
    args : list of str or None
        ROS arguments; None for those of the process.
    stopping : list of int
        Signals that end the node, see `signals.noted`.

    Returns
    -------
    int
        Exit status, see `run_node`.
    """
    node, status = None, 0
    try:
        command_line.initialise(node_class, args)
        node = _make(node_class)
        with signals.raised(stopping):
            _start(node, stopping)
        _spin(node, stopping)
        status = 0 if node.failure is None else 2 if isinstance(node.failure, ConfigError) else 1
    except ConfigError as error:
        print(f"{node_class.node_name}: {error}", file=sys.stderr)
        status = 2
    except (ExternalShutdownException, KeyboardInterrupt):
        # A supervisor that reads the failure in /diagnostics may interrupt before the node ends by itself.
        if node is not None and isinstance(node.failure, ConfigError):
            status = 2
    finally:
        if node is not None:
            try:
                node.make_safe()
            except Exception:  # the steps after it are still necessary
                node.get_logger().error(traceback.format_exc())
                status = status or 1
            with contextlib.suppress(RCLError):  # an interrupted transition permits no other one
                node.trigger_shutdown()
            node.diagnostics.publish()
            middleware.deliver(node)
            node.destroy_node()
        rclpy.try_shutdown()
    return status


def _make(node_class: type[SoroNode[Config]]) -> SoroNode[Config]:
    try:
        return node_class()
    except (InvalidParameterValueException, ValueError) as error:
        raise ConfigError(
            f"parameters of {node_class.node_name}", "", str(error), "values with a type"
        ) from None


def _start(node: SoroNode[Config], stopping: list[int]) -> None:
    """Configure and activate the node, if `autostart` is true.

    If that fails the node stays, as others in ROS, unless it is to end then.
    """
    node.stopping = stopping
    try:
        if node.get_parameter_or("autostart").value:
            node.trigger_configure()
            failed = "configure" if node.failure is not None else ""
            if not failed:
                node.trigger_activate()
                failed = "activate" if node.failure is not None else ""
            if failed and node.get_parameter_or("end_on_failed_start").value:
                node.finish()
            if failed and not node.finished:
                again = f"ros2 lifecycle set {node.get_fully_qualified_name()} {failed}"
                node.get_logger().info(f"waiting for another try: {again}")
    finally:
        node.stopping = []  # later errors are no interrupts


def _spin(node: SoroNode[Config], stopping: list[int]) -> None:
    from rclpy.experimental.events_executor import EventsExecutor

    if node.finished:
        return
    executor = EventsExecutor()
    executor.add_node(node)
    timing.shorten_pauses()
    _prioritise(node)
    try:
        while not stopping and not node.finished:
            executor.spin_once(timeout_sec=SPIN_WAIT_S)
    except SoroError as error:  # raised in a callback
        node.fail(error)


def _prioritise(node: SoroNode[Config]) -> None:
    """Request the node's real-time priority; without the right to it the node logs a warning and runs on."""
    if node.priority > 0 and (trouble := timing.prioritise(node.priority)):
        node.get_logger().warning(f"no real-time priority ({trouble}): see docs/real_time.md")
