"""The emergency stop as a topic: real publishers, the regulator node on emulated valves."""

import threading
import time

import numpy as np
import pytest
import rclpy
import yaml
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Bool

from soro_hardware import load_platform
from soro_hardware.canopen.driver import CanopenRegulator
from soro_ros.conversion import messages
from soro_ros.nodes import regulator
from soro_ros.topics import stop_topic
from soro_ros.topics.stop_topic import reading_stop
from tests.soro_hardware.hub_bus import HubBus
from tests.soro_ros.direct import active, fire, receive, request
from tests.soro_ros.running import wait_until

CYCLE_S = 5e-3
CHAMBERS = [f"link0/chamber{n}" for n in range(3)]
TOPIC = "/safety/stop"


class Button:
    """A program that tells the state of a stop every 20 ms, in a context of its own."""

    def __init__(self, says=False):
        self.says = says
        self._context = rclpy.Context()
        self._context.init()
        self._node = rclpy.create_node("button", context=self._context)
        self._publisher = self._node.create_publisher(Bool, TOPIC, 10)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._tell)
        self._thread.start()

    def _tell(self):
        while not self._ended.wait(0.02):
            if self.says is not None:
                self._publisher.publish(Bool(data=self.says))

    def close(self):
        self._ended.set()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def button(domain):
    """Makes buttons that are gone at the end."""
    made = []

    def make(says=False):
        made.append(Button(says))
        return made[-1]

    yield make
    for one in made:
        one.close()


class Arm:
    """The regulator node on emulated valves, cycle by cycle; its messages come through the middleware."""

    def __init__(self, node, bus, advance):
        self.node, self._bus, self._advance = node, bus, advance
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)

    def cycle(self, pressure_pa):
        self._executor.spin_once(timeout_sec=0.001)
        now_ns = self._advance()
        command = messages.chambers(CHAMBERS, np.full(3, pressure_pa), now_ns)
        receive(self.node, "chambers/command", (command, {"publication_sequence_number": None}))
        fire(self.node, CYCLE_S)
        return self._bus.world.pressure_pa

    def until(self, condition, what, pressure_pa=10e3):
        wait_until(lambda: (self.cycle(pressure_pa), condition())[1], what, every_s=0.0)

    @property
    def cause(self):
        return self.node._limited.cause

    def ask(self, service):
        return request(self.node, f"~/{service}")


@pytest.fixture
def arm(domain, tmp_path, monkeypatch):
    """Start it with the platform's keys changed."""
    opened = []

    def start(**keys):
        platform = load_platform("emulated_canopen").model_dump(mode="json")
        path = tmp_path / "stop.yaml"
        # Longest silence by default: a busy machine must not look like a dead button.
        path.write_text(yaml.safe_dump({**platform, "stop_topic": TOPIC, "stop_timeout_s": 2.0, **keys}))
        loaded = load_platform(str(path))
        bus = HubBus(loaded, seed=1)
        driver = CanopenRegulator(loaded, lambda: bus, time.monotonic, lockstep=True)
        monkeypatch.setattr(regulator, "open_regulator", lambda *_, **__: driver)
        now_ns = [0]
        for name in ("_now_ns", "_stamp_ns"):
            monkeypatch.setattr(regulator.RegulatorNode, name, lambda node: now_ns[0])

        def advance():
            now_ns[0] += round(1e9 * CYCLE_S)
            return now_ns[0]

        context = active(regulator.RegulatorNode, "device:=/dev/x", "keep_latch:=false", f"platform:={path}")
        node = context.__enter__()
        opened.append((context, node))
        return Arm(node, bus, advance)

    yield start
    for context, node in opened:
        node.make_safe()
        context.__exit__(None, None, None)


def pressed_and_released(arm, button):
    """Press a button; release it, and reset."""
    button.says = True
    arm.until(lambda: arm.cause is not None, "the trip")
    assert arm.cause == f"stop pressed: {TOPIC} says so"
    arm.cycle(0.0)
    for service in ("reset", "enable"):
        answer = arm.ask(service)
        assert not answer.success
        assert "stop pressed" in answer.message
    button.says = False
    arm.until(lambda: arm.node._limited.why_stopped() is None, "the release", 0.0)
    assert arm.cause is not None, "a released stop resets nothing"
    assert arm.ask("reset").success
    assert arm.ask("enable").success


@pytest.mark.slow
def test_a_pressed_stop_trips_and_refuses_reset_and_enable(button, arm):
    stop = button()
    it = arm()
    it.until(lambda: it.cycle(10e3).min() > 5e3, "pressure")
    assert it.cause is None
    pressed_and_released(it, stop)
    it.until(lambda: it.cycle(10e3).min() > 5e3, "pressure again")


def test_silence_counts_as_pressed(button, arm):
    stop = button()
    it = arm(stop_timeout_s=0.2)
    it.until(lambda: it.cycle(10e3).min() > 5e3, "pressure")
    stop.says = None
    it.until(lambda: it.cause is not None, "the trip")
    assert it.cause.startswith(f"stop silent: no message on {TOPIC} for ")
    it.until(lambda: it.cycle(0.0).max() < 1e3, "the vent", 0.0)
    assert "stop silent" in it.ask("reset").message
    stop.says = False
    it.until(lambda: it.ask("reset").success, "the reset", 0.0)


@pytest.mark.slow
def test_of_two_publishers_the_one_that_says_pressed_counts(button, arm):
    first, _ = button(), button()
    it = arm()
    it.until(lambda: it.cycle(10e3).min() > 5e3, "pressure")
    pressed_and_released(it, first)


def test_nothing_heard_at_the_start_is_a_closed_latch(arm, button, monkeypatch):
    monkeypatch.setattr(stop_topic, "FIRST_S", 0.05)
    it = arm()
    assert "no message on /safety/stop yet" in it.ask("enable").message
    assert it.cycle(10e3).max() < 1e3
    assert it.cause.startswith("stop silent: no message on /safety/stop yet")
    button()
    it.until(lambda: it.ask("reset").success, "the reset", 0.0)


def test_a_platform_without_the_topic_listens_to_none(arm):
    it = arm(stop_topic="")
    assert not [one for one in it.node.subscriptions if one.msg_type is Bool]
    it.until(lambda: it.cycle(10e3).min() > 5e3, "pressure")


def test_a_command_without_a_node_hears_it_too(button):
    stop = button()
    platform = load_platform("emulated_canopen").model_copy(update={"stop_topic": TOPIC})
    with reading_stop(platform) as why_stopped:
        assert why_stopped() is None
        stop.says = True
        wait_until(lambda: why_stopped() == f"stop pressed: {TOPIC} says so", "the stop")
    assert not rclpy.ok()
