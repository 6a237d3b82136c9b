"""Each field of the messages that the driver node reads, at its extremes: it lives, no valve obeys."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool, Float64MultiArray

from soro_hardware import load_platform
from soro_hardware.canopen.driver import CanopenRegulator
from soro_ros.conversion import messages
from soro_ros.nodes import regulator
from soro_ros.topics.intra_process import HANDED_OVER
from soro_ros.topics.stop_topic import StopTopic
from tests.soro_hardware.hub_bus import HubBus
from tests.soro_ros.direct import active, captured, receive, request
from tests.soro_ros.extremes import extremes
from tests.soro_ros.test_extreme_messages import CHAMBERS, HIGHEST_PA, assert_finite

CYCLE_S, STOP = 5e-3, "/safety/stop"
CYCLE_NS = round(1e9 * CYCLE_S)
GOOD = np.array([10e3, 12e3, 14e3])


@pytest.fixture
def driver(domain, tmp_path, monkeypatch):
    """The node on emulated valves, in lockstep."""
    platform = load_platform("emulated_canopen").model_dump(mode="json")
    path = tmp_path / "stop.yaml"
    path.write_text(yaml.safe_dump({**platform, "stop_topic": STOP, "stop_timeout_s": 2.0}))
    loaded = load_platform(str(path))
    bus = HubBus(loaded, seed=1)
    opened = CanopenRegulator(loaded, lambda: bus, time.monotonic, lockstep=True)
    monkeypatch.setattr(regulator, "open_regulator", lambda *_, **__: opened)
    monkeypatch.setattr(StopTopic, "wait", lambda self: self._on_message(Bool(data=False)))
    with active(regulator.RegulatorNode, "device:=/dev/x", "mode:=lockstep", f"platform:={path}") as node:
        yield node
        node.make_safe()


class Person:
    """Someone who gives the time, good commands, and after a vent what a reset needs."""

    def __init__(self, node):
        self.node, self.tick_ns = node, 0

    def tick(self):
        self.tick_ns += CYCLE_NS
        receive(self.node, STOP, Bool(data=False))
        receive(self.node, "/clock", Clock(clock=messages.to_time(self.tick_ns)))

    def command(self, pressure_pa, stamp_ns):
        command = messages.chambers(CHAMBERS, pressure_pa, stamp_ns)
        receive(self.node, "chambers/command", (command, HANDED_OVER))

    def cycle(self, pressure_pa=GOOD):
        self.tick()
        self.command(pressure_pa, self.tick_ns)

    def goes_on(self):
        """Command for a while, after a reset where one is needed."""
        for _ in range(200):
            if self.node._limited.cause is None:
                break
            self.cycle(np.zeros(3))
            request(self.node, "~/reset")
        for _ in range(4):
            self.cycle()
        assert self.node._limited.cause is None


def given():
    return {
        "chambers/command": lambda t: messages.chambers(CHAMBERS, GOOD, t),
        "chambers/commands": lambda t: Float64MultiArray(data=list(GOOD)),
        "/clock": lambda t: Clock(clock=messages.to_time(t)),
    }


@pytest.mark.parametrize("topic", list(given()))
def test_regulator(driver, topic, monkeypatch):
    node, raised, said = driver, [], []
    logger = SimpleNamespace(warning=lambda line, **_: said.append(line), error=said.append, info=said.append)
    monkeypatch.setattr(node, "get_logger", lambda: logger)
    readings, it = captured(node, "chambers/state"), Person(node)
    it.goes_on()
    for what, message in extremes(given()[topic](it.tick_ns)):
        if hasattr(message, "header") and "stamp" not in what:
            message.header.stamp = messages.to_time(it.tick_ns + CYCLE_NS)
        try:
            it.tick()
            receive(node, topic, (message, HANDED_OVER) if "chambers" in topic else message)
            if topic == "/clock":
                it.command(GOOD, messages.to_ns(message.clock))
            node.diagnose()
            it.goes_on()
        except Exception as error:
            raised.append(f"{what}: {type(error).__name__}: {error}")
    assert not raised, "\n".join(raised)
    assert_finite(readings)
    assert all(-5e3 <= x <= HIGHEST_PA for one in readings for x in one.effort)
    long = [one[:200] for one in said if len(one) > 500 or "\n" in one]
    assert not long, "\n".join(long)


def test_a_command_that_comes_before_its_tick_answers_it(driver):
    """Two topics have no common order: /clock may come last, also the first time."""
    readings, it = captured(driver, "chambers/state"), Person(driver)
    it.tick_ns = 10**10
    for k in range(3):
        it.command(GOOD, it.tick_ns)
        it.tick()
        assert len(readings) == k + 1
