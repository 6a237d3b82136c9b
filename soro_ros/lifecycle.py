"""The base of every node: lifecycle, checked parameters, diagnostics, and an end that vents first."""

from __future__ import annotations

import contextlib
import gc
import signal
import sys
import time
import traceback
from collections.abc import Callable
from typing import ClassVar, Generic, TypeVar

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.timer import Timer

from soro_core.config import Strict
from soro_core.errors import ConfigError, SoroError
from soro_ros import command_line, middleware, signals, timing
from soro_ros.diagnostics import ERROR, OK, Diagnostics
from soro_ros.parameters import declare, read

RCLError = rclpy_implementation.RCLError

Config = TypeVar("Config", bound=Strict)

# rclpy's own spin() of the events executor never returns to Python; a bounded wait lets signals through.
SPIN_WAIT_S = 0.1
# Longest time for what the middleware does when Python has ended.
LEAVE_S = 10


class SoroNode(LifecycleNode, Generic[Config]):
    """A lifecycle node over a configuration model.

    A node overrides `setup`, `start`, `stop` and `teardown`; each may raise SoroError, which becomes one
    logged line, an ERROR diagnostic and a failed transition. `make_safe` runs before everything else when
    the process ends, whatever the state: it must not raise and must not need ROS.
    """

    config_model: ClassVar[type[Strict]]
    node_name: ClassVar[str]

    def __init__(self) -> None:
        super().__init__(self.node_name, automatically_declare_parameters_from_overrides=True)
        declare(self, self.config_model)
        self.steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.diagnostics = Diagnostics(self)
        self.create_timer(1.0, self._publish_diagnostics, clock=self.steady_clock)
        self.failure: SoroError | None = None
        self.finished = False
        self._timers_active: list[Timer] = []
        self._configured = False
        # What the node has before `setup`; everything beyond goes when it is cleaned up.
        self._kept = self._interfaces()

    # What a node overrides -----------------------------------------------------------------------
    def setup(self, config: Config) -> None:
        """Build everything that the configuration asks for (unconfigured -> inactive)."""

    def start(self) -> None:
        """Start timers and work (inactive -> active)."""

    def stop(self) -> None:
        """Stop work (active -> inactive)."""

    def teardown(self) -> None:
        """Release what `setup` built (inactive -> unconfigured)."""

    def make_safe(self) -> None:
        """Put hardware and files into a safe state; called first when the process ends."""

    def diagnose(self) -> None:
        """Refresh `self.diagnostics`; called once a second."""

    # What a node uses ----------------------------------------------------------------------------
    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Call back on the steady clock until the node is deactivated (lifecycle does not stop timers)."""

        def guarded() -> None:
            try:
                callback()
            except SoroError as error:  # the executor would print a traceback
                self.fail(error)

        timer = self.create_timer(period_s, guarded, clock=self.steady_clock)
        self._timers_active.append(timer)
        return timer

    def compile(self, warm_up: Callable[[], None]) -> None:
        """Run `warm_up`, which calls every kernel once, so that the loop never compiles one."""
        from soro_core._jit import compiling_once
        from soro_ros import kernels

        begin = time.monotonic()
        if not kernels.compiled():
            self.get_logger().info("compiling the model's kernels: up to a minute, cached afterwards")
        with compiling_once():
            warm_up()
        self.get_logger().info(f"kernels are ready after {time.monotonic() - begin:.1f} s")

    def finish(self) -> None:
        """End the process cleanly: the node's work is done."""
        self.finished = True

    def fail(self, error: SoroError) -> None:
        """End the process with an error: the node cannot go on."""
        self.failure, self.finished = error, True
        self.get_logger().error(str(error))
        self.diagnostics.update(ERROR, str(error))

    # Lifecycle -----------------------------------------------------------------------------------
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        def configure() -> None:
            self._kept = self._interfaces()
            self.setup(read(self, self.config_model))
            self._configured = True

        result = self._transition(configure, "inactive")
        if result is TransitionCallbackReturn.FAILURE:
            # Half of it may stand: a port left open would be in the way of the next try.
            failure = self.failure
            self.make_safe()
            self._destroy_interfaces()
            self.failure = failure
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        super().on_activate(state)
        return self._transition(self.start, "active")

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._stop_timers()
        result = self._transition(self.stop, "inactive")
        super().on_deactivate(state)
        return result

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._configured = False
        result = self._transition(self.teardown, "unconfigured")
        self._destroy_interfaces()
        return result

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.make_safe()
        self._stop_timers()
        return self._transition(self.teardown, "finalized")

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.make_safe()
        self._stop_timers()
        return TransitionCallbackReturn.SUCCESS

    def _transition(self, action: Callable[[], None], name: str) -> TransitionCallbackReturn:
        try:
            action()
        except Exception as error:
            # rclpy would log a defect and go on as if the transition had been asked for by nobody.
            known = isinstance(error, SoroError)
            self.failure = error if known else SoroError(f"{type(error).__name__}: {error}")
            self.get_logger().error(str(error) if known else traceback.format_exc())
            self.diagnostics.update(ERROR, str(self.failure))
            return TransitionCallbackReturn.FAILURE
        self.failure = None
        if self.diagnostics.status.level == OK:
            self.diagnostics.update(OK, name)
        self.diagnostics.lifecycle(name)
        return TransitionCallbackReturn.SUCCESS

    def _interfaces(self) -> set[int]:
        """Identities only: a reference would keep handles alive beyond the node that they belong to."""
        owned = (self.publishers, self.subscriptions, self.services, self.clients, self.timers)
        return {id(item) for items in owned for item in items}

    def _destroy_interfaces(self) -> None:
        """Destroy what `setup` created: a second configuration must not leave two of anything alive."""
        for items, destroy in (
            (self.publishers, self.destroy_publisher),
            (self.subscriptions, self.destroy_subscription),
            (self.services, self.destroy_service),
            (self.clients, self.destroy_client),
            (self.timers, self.destroy_timer),
        ):
            for item in [item for item in items if id(item) not in self._kept]:
                destroy(item)

    def _stop_timers(self) -> None:
        for timer in self._timers_active:
            timer.cancel()
            self.destroy_timer(timer)
        self._timers_active.clear()

    def _publish_diagnostics(self) -> None:
        if self._configured:
            self.diagnose()
        self.diagnostics.publish()


def run_node(node_class: type[SoroNode[Config]], args: list[str] | None = None) -> None:
    """Run one node as a process: exit 0 after a clean end, 2 on a wrong configuration, 1 on a failure.

    SIGINT and SIGTERM are handled here and not by rclpy, whose handler shuts the context down before
    Python runs, so that a safe state could no longer be announced.
    """
    with signals.noted() as stopping:
        status = _run(node_class, args, stopping)
    # All is done. The middleware takes its leave after Python's end; should it hang there, at real-time
    # priority, the kernel ends it.
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(LEAVE_S)
    raise SystemExit(status)


def _run(node_class: type[SoroNode[Config]], args: list[str] | None, stopping: list[int]) -> int:
    node, status = None, 0
    try:
        command_line.initialise(node_class, args)
        node = _make(node_class)
        with signals.raised(stopping):
            _start(node)
        _spin(node, stopping)
        status = 0 if node.failure is None else 2 if isinstance(node.failure, ConfigError) else 1
    except ConfigError as error:
        print(f"{node_class.node_name}: {error}", file=sys.stderr)
        status = 2
    except (ExternalShutdownException, KeyboardInterrupt):
        pass
    finally:
        if node is not None:
            try:
                node.make_safe()
            except Exception:  # what comes after must still be done
                node.get_logger().error(traceback.format_exc())
                status = status or 1
            with contextlib.suppress(RCLError):  # interrupted within a transition: there is none from there
                node.trigger_shutdown()
            node.diagnostics.publish()
            middleware.deliver(node)
            node.destroy_node()
        rclpy.try_shutdown()
    return status


def _make(node_class: type[SoroNode[Config]]) -> SoroNode[Config]:
    try:
        return node_class()
    except (InvalidParameterValueException, ValueError) as error:  # rclpy: ValueError for `a:=[]`
        raise ConfigError(
            f"parameters of {node_class.node_name}", "", str(error), "values with a type"
        ) from None


def _start(node: SoroNode[Config]) -> None:
    """Configure and activate where `autostart` says so."""
    if node.get_parameter_or("autostart").value:
        node.trigger_configure()
        if node.failure is None:
            node.trigger_activate()


def _spin(node: SoroNode[Config], stopping: list[int]) -> None:
    from rclpy.experimental.events_executor import EventsExecutor

    if node.failure is not None:
        return
    executor = EventsExecutor()
    executor.add_node(node)
    # Collector pauses and thread switches are the larger part of a Python loop's lateness.
    sys.setswitchinterval(0.0002)
    gc.collect()
    gc.freeze()
    _prioritise(node, _priority(node))
    try:
        while not stopping and not node.finished:
            executor.spin_once(timeout_sec=SPIN_WAIT_S)
    except SoroError as error:  # raised in a callback
        node.fail(error)


def _priority(node: SoroNode[Config]) -> int:
    """Real-time priority to ask for: none in lockstep, which has all the time."""
    real_time = node.has_parameter("priority") and node.get_parameter("mode").value == "real_time"
    return int(node.get_parameter("priority").value) if real_time else 0


def _prioritise(node: SoroNode[Config], priority: int) -> None:
    """Ask for a real-time priority; without the right to it the node runs on, and says so once."""
    if priority > 0 and (trouble := timing.prioritise(priority)):
        node.get_logger().warning(f"no real-time priority ({trouble}): see docs/real_time.md")
