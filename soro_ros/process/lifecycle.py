"""Base class of every node: lifecycle, checked parameters, diagnostics, and an end that vents first."""

from __future__ import annotations

import time
import traceback
from array import array
from collections.abc import Callable, Container, Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock as ClockMessage

from soro_core.config import Strict
from soro_core.errors import NEXT_CONFIGURE, ConfigError, SoroError
from soro_ros.host.event_log import EventLog
from soro_ros.process.clock_watch import ClockWatch, with_possible_time
from soro_ros.process.parameters import NodeWithParameters, declare, overrides, read
from soro_ros.topics.diagnostics import ERROR, OK, Diagnostics
from soro_ros.topics.intra_process import NodeWithHandover

Config = TypeVar("Config", bound=Strict)
Interface = TypeVar("Interface")


class SoroNode(NodeWithHandover, NodeWithParameters, LifecycleNode, Generic[Config]):
    """A lifecycle node over a configuration model.

    A node overrides `setup`, `start`, `stop` and `teardown`; each may raise SoroError, which becomes one
    logged line, an ERROR diagnostic and a failed transition. `make_safe` runs before everything else when
    the process ends, whatever the state: it must not raise and must not need ROS.
    """

    config_model: type[Config]
    # Parameters, or beginnings of their names, that `take` takes over while the node is configured.
    live: ClassVar[tuple[str, ...]] = ()
    node_name: ClassVar[str]
    # Parameter that names what the diagnostics are about.
    hardware: ClassVar[str] = "robot"
    # Whether the arm does without this node: it looks on, and two of one name do no harm.
    is_observer: ClassVar[bool] = False

    def __init__(self, namespace: str | None = None) -> None:
        super().__init__(
            self.node_name, namespace=namespace, automatically_declare_parameters_from_overrides=True
        )
        self._used: Config | None = None  # the configuration in force, of a configured node
        self.event_log = EventLog(self.get_namespace(), self.get_name(), self.get_logger().warning)
        declare(self, self.config_model, self._changed)
        self.steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        named = self.get_parameter_or(self.hardware).value
        named = named if isinstance(named, str) or not named else named[0]
        self.diagnostics = Diagnostics(self, Path(named).name.removesuffix(".yaml") if named else "")
        self.clock_watch = ClockWatch(self)
        self.create_timer(1.0, self._each_second, clock=self.steady_clock)
        self.failure: SoroError | None = None
        self.finished = False
        self.stopping: list[int] = []  # signals that interrupt the start
        self._timers_active: list[Timer] = []
        self._configured = False
        # Interfaces that exist before `setup`, all others are its own; None before the first `setup`.
        self._kept: set[int] | None = None

    @property
    def priority(self) -> int:
        """Real-time priority that the node requests; 0, none, in lockstep, which has no deadlines."""
        is_real_time = self.has_parameter("priority") and self.get_parameter("mode").value == "real_time"
        return int(self.get_parameter("priority").value) if is_real_time else 0

    # What a node overrides -----------------------------------------------------------------------
    def setup(self, config: Config) -> None:
        """Build everything that the configuration asks for (unconfigured -> inactive)."""

    def start(self) -> None:
        """Start timers and work (inactive -> active)."""

    def stop(self) -> None:
        """Stop work (active -> inactive)."""

    def teardown(self) -> None:
        """Release what `setup` built (inactive -> unconfigured)."""

    def take(self, config: Config) -> None:
        """Take over at once, without a step, a configuration in which only `live` parameters differ.

        Raise SoroError to refuse it; then nothing may have changed.
        """

    def claims(self) -> tuple[str, ...]:
        """Return the names that no other program of the domain may use meanwhile."""
        return () if self.is_observer else (self.get_fully_qualified_name(),)

    def make_safe(self) -> None:
        """Put hardware and files into a safe state; called first when the process ends."""

    def diagnose(self) -> None:
        """Refresh `self.diagnostics`; called once a second."""

    # What a node uses ----------------------------------------------------------------------------
    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Call a function periodically, by the steady clock, until the node is deactivated."""

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
        from soro_ros.process import kernels

        begin = time.monotonic()
        if kernels.none_is_compiled():
            self.get_logger().info("compiling the model's kernels: some minutes, cached afterwards")
        with compiling_once():
            warm_up()
        self.get_logger().info(f"kernels are ready after {time.monotonic() - begin:.1f} s")

    def finish(self) -> None:
        """End the process cleanly: the node's work is done."""
        self.finished = True

    def fail(self, error: SoroError) -> None:
        """End the process with an error: the node cannot continue."""
        self.failure, self.finished = error, True
        self.get_logger().error(str(error))
        self.diagnostics.update(ERROR, str(error))

    def note_failure(self, error: Exception) -> SoroError:
        """Keep an error that is being handled as the failure of the node, log it, and return the failure."""
        known = error if isinstance(error, SoroError) else None
        self.failure = failure = known or SoroError(f"{type(error).__name__}: {error}")
        self.get_logger().error(str(failure) if known else traceback.format_exc())
        return failure

    # Lifecycle -----------------------------------------------------------------------------------
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        def configure() -> None:
            self._kept = self._interfaces()
            config = read(self, self.config_model)
            self.setup(config)
            self._configured, self._used = True, config

        result = self._transition(configure, "inactive")
        if result is TransitionCallbackReturn.FAILURE:
            # A port that `setup` opened before its error would prevent the next try.
            failure = self.failure
            self.make_safe()
            self._destroy_interfaces()
            self.failure = failure
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        super().on_activate(state)
        result = self._transition(self.start, "active")
        if result is TransitionCallbackReturn.FAILURE:
            # What `start` began before its error would go on, and prevent the next try.
            self._stop_timers()
            try:
                self.stop()
            except Exception:
                self.get_logger().error(traceback.format_exc())
            super().on_deactivate(state)
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._stop_timers()
        result = self._transition(self.stop, "inactive")
        super().on_deactivate(state)
        return result

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._configured, self._used = False, None
        result = self._transition(self.teardown, "unconfigured")
        self._destroy_interfaces()
        return result

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.make_safe()
        self._stop_timers()
        self._configured, self._used = False, None
        result = self._transition(self.teardown, "finalized")
        self._destroy_interfaces(with_publishers=False)
        return result

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.make_safe()
        self._stop_timers()
        self._configured, self._used = False, None
        self._destroy_interfaces()
        return TransitionCallbackReturn.SUCCESS

    def _transition(self, action: Callable[[], None], name: str) -> TransitionCallbackReturn:
        try:
            action()
        except Exception as error:
            if self.stopping:  # an interrupt in a callback of the compiler becomes another error
                raise KeyboardInterrupt from None
            # rclpy would only log the error and leave the transition out.
            self.diagnostics.update(ERROR, str(self.note_failure(error)))
            return TransitionCallbackReturn.FAILURE
        said, failure = self.diagnostics, self.failure
        self.failure = None
        # An earlier failure is over, unless this is the end of the node.
        recovered = failure is not None and said.message == str(failure) and name != "finalized"
        if recovered or said.level == OK:
            self.diagnostics.update(OK, name)
        self.diagnostics.lifecycle(name)
        return TransitionCallbackReturn.SUCCESS

    def _changed(self, config: Config) -> None:
        """Take over changed parameters; refuse those that only the next configuration can use."""
        now = overrides(config)
        if self._used is None:
            self._log_changes({name: self.get_parameter_or(name).value for name in now}, now)
            return
        before = overrides(self._used)
        for name, value in now.items():
            if value != before.get(name) and not name.startswith(self.live):
                allowed = f"{before.get(name)!r}; another value {NEXT_CONFIGURE}: clean up, set it, configure"
                raise ConfigError(f"parameters of {self.get_name()}", name, value, allowed)
        if config != self._used:
            self.take(config)
            self._used = config
            self._log_changes(before, now)

    def _log_changes(self, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
        if self.is_observer:
            return
        for name, value in now.items():
            then = before.get(name)
            if value != (list(then) if isinstance(then, (tuple, array)) else then) and (then or value):
                self.event_log.note("parameter", f"{name}: {then!r} -> {value!r}")

    def create_subscription(
        self, msg_type: type[Any], topic: str, callback: Callable[..., None], *arguments: Any, **options: Any
    ) -> Subscription:
        """Create a subscription; rclpy itself subscribes to /clock with it.

        Parameters
        ----------
        msg_type, topic, callback, *arguments, **options : Any
            As in rclpy.
        """
        if msg_type is ClockMessage and not options.get("raw"):
            callback = with_possible_time(self, callback)
        return super().create_subscription(msg_type, topic, callback, *arguments, **options)

    def destroy_node(self) -> None:
        """Write the last events, and destroy the node."""
        self.event_log.close()
        super().destroy_node()

    def _interfaces(self) -> set[int]:
        """Return identities only: references would keep handles alive after the end of their node."""
        owned = (self.publishers, self.subscriptions, self.services, self.clients, self.timers)
        return {id(item) for items in owned for item in items}

    def _destroy_interfaces(self, with_publishers: bool = True) -> None:
        """Destroy the interfaces that `setup` created; a second configuration must not duplicate them.

        A node that has ended must not be called through them; its last messages may still be on their way.
        """
        kept = self._kept
        if kept is None:
            return
        if with_publishers:
            _destroy_others(kept, self.publishers, self.destroy_publisher)
        _destroy_others(kept, self.subscriptions, self.destroy_subscription)
        _destroy_others(kept, self.services, self.destroy_service)
        _destroy_others(kept, self.clients, self.destroy_client)
        _destroy_others(kept, self.timers, self.destroy_timer)

    def _stop_timers(self) -> None:
        for timer in self._timers_active:
            timer.cancel()
            self.destroy_timer(timer)
        self._timers_active.clear()

    def _each_second(self) -> None:
        self.clock_watch.check()
        if self._configured and self.failure is None:
            self.diagnose()
        self.diagnostics.publish()


def _destroy_others(
    kept: Container[int], items: Iterable[Interface], destroy: Callable[[Interface], object]
) -> None:
    """Destroy interfaces other than those with these identities."""
    for item in [item for item in items if id(item) not in kept]:
        destroy(item)
