"""chambers/state while a device is silent, who reads it, and what stops; and the state of the latch."""

import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

from soro_hardware import load_platform
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_ros.conversion import learning, messages, qos
from soro_ros.nodes import regulator
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.estimator import EstimatorNode
from soro_ros.nodes.exciter import ExciterNode
from soro_ros.topics.diagnostics import ERROR, OK, WARN
from tests.soro_hardware.hub_bus import HubBus
from tests.soro_ros.direct import active, captured, fire, receive, request, values
from tests.soro_ros.running import wait_until
from tests.soro_ros.test_frames import CHAMBERS, COORDINATES, TICK_NS, upright

SILENT = np.array([1e3, np.nan, 2e3])
CYCLE_S = 5e-3


def tick(node, k, pressure_pa):
    receive(node, "sensors/pose0", upright(k * TICK_NS, "world"))
    receive(node, "chambers/state", messages.chambers(CHAMBERS, pressure_pa, k * TICK_NS))


@pytest.fixture
def emulated(domain, monkeypatch):
    """The regulator node over the driver of emulated CANopen valves, without processes."""
    platform = load_platform("emulated_canopen")
    bus = HubBus(platform, seed=1)
    driver = CanopenRegulator(platform, lambda: bus, time.monotonic, lockstep=True)
    monkeypatch.setattr(regulator, "open_regulator", lambda *_, **__: driver)
    now_ns = [0]
    monkeypatch.setattr(regulator.RegulatorNode, "_now_ns", lambda node: now_ns[0])

    def cycle(node):
        now_ns[0] += round(1e9 * CYCLE_S)  # that of the emulated valves, not of the machine
        fire(node, CYCLE_S)

    with active(regulator.RegulatorNode, "device:=/dev/valves", "keep_latch:=false") as node:
        yield node, bus.world.faults, lambda: cycle(node)
        node.make_safe()


def test_the_others_are_told_while_one_is_silent_and_panels_are_told_of_the_latch(emulated):
    node, faults, cycle = emulated
    told, states = captured(node, "chambers/state"), []
    panel = rclpy.create_node("panel")
    panel.create_subscription(DiagnosticStatus, "chambers/latch", states.append, qos.LATCHED)
    executor = SingleThreadedExecutor()
    executor.add_node(panel)

    def shows(level: bytes) -> bool:
        executor.spin_once(timeout_sec=0.01)
        return bool(states) and states[-1].level == level

    wait_until(lambda: shows(OK), "the state from before the panel was there")
    assert states[-1].message == "open"
    cycle()
    assert np.isfinite(told[-1].effort).all()
    faults.add(read_injection("fault: mute, chamber: link0/chamber1"))
    for _ in range(40):
        cycle()
    assert np.isnan(told[-1].effort).tolist() == [False, True, False]
    assert list(told[-1].name) == list(CHAMBERS)
    wait_until(lambda: shows(ERROR), "the latch")
    said = {pair.key: pair.value for pair in states[-1].values}
    assert said["cause"].startswith("stale_reading: link0/chamber1")
    assert (said["latched"], said["vented"], said["not_vented"]) == ("true", "true", "")
    assert states[-1].message == f"vented: {said['cause']}"
    assert (states[-1].hardware_id, states[-1].name) == ("/dev/valves", "/regulator")
    assert node.diagnostics.status.hardware_id == "/dev/valves"
    faults.clear()
    assert request(node, "~/reset").success
    wait_until(lambda: shows(OK), "the open latch")
    assert {pair.key: pair.value for pair in states[-1].values}["latched"] == "false"
    cycle()
    assert np.isfinite(told[-1].effort).all()
    panel.destroy_node()


def test_without_all_readings_there_is_no_estimate_and_nothing_is_drawn(domain):
    with active(EstimatorNode) as node:
        drawn, sent = captured(node, "arm/backbone"), captured(node, "arm/state")
        tips = captured(node, "arm/tip")
        for k in range(1, 30):
            tick(node, k, np.zeros(3))
        assert ticks(drawn) == [2, 12, 22], "each 50 ms, from the first estimate on"
        assert set(ticks(drawn)) <= set(ticks(sent))
        assert drawn[0].header.frame_id == "world"
        count, pressure = len(sent), node.state.pressure_pa
        for k in range(30, 40):
            tick(node, k, SILENT)
        assert (len(drawn), len(sent), len(tips)) == (3, count, count)
        assert node.state.pressure_pa is pressure
        assert node.diagnostics.status.level == WARN
        assert node.diagnostics.status.message == "no estimate: no reading of link0/chamber1"
        for k in range(40, 43):
            tick(node, k, np.zeros(3))
        assert (ticks(drawn)[3:], len(sent)) == ([40, 42], count + 3)
        assert node.diagnostics.status.level == OK
        for k in range(43, 60):
            tick(node, k, SILENT)
        assert len(drawn) == 5, "there is no estimate any more"
        tick(node, 60, np.zeros(3))
        tick(node, 61, np.zeros(3))
        assert ticks(drawn)[5:] == [60], "after a gap none is made up for"


def ticks(drawn):
    return [messages.to_ns(one.header.stamp) // TICK_NS for one in drawn]


def test_the_arm_is_drawn_when_the_command_that_answers_the_estimate_has_gone_out(domain, monkeypatch):
    with active(EstimatorNode) as node:
        drawn, later = captured(node, "arm/backbone"), []
        monkeypatch.setattr(node, "after_handover", later.append)
        for k in range(1, 4):
            tick(node, k, np.zeros(3))
        (draw,) = (one for one in later if one == node._draw)
        assert drawn == []
        draw()
        assert ticks(drawn) == [3], "the newest estimate"


def test_the_backbone_stops_when_no_sample_comes(domain):
    with active(EstimatorNode) as node:
        drawn = captured(node, "arm/backbone")
        for k in range(1, 300):
            if k < 30:
                receive(node, "sensors/pose0", upright(k * TICK_NS, "world"))
            receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), k * TICK_NS))
        last_s = messages.to_ns(drawn[-1].header.stamp) * 1e-9
        end_s = 29 * 0.005 + node.estimator.config.lost_after_s
        assert end_s - 0.061 < last_s < end_s + 0.011


def test_in_lockstep_each_tick_has_its_answer(domain):
    with active(EstimatorNode, "mode:=lockstep", "pose_rate_hz:=200.0", "learned:=true") as node:
        sent, spread = captured(node, "arm/state"), captured(node, "arm/covariance")
        for k in range(10):
            tick(node, k, SILENT if 4 <= k < 7 else np.zeros(3))
            receive(node, "arm/learned", learning.learned(None, k * TICK_NS))
        assert [messages.to_ns(one.header.stamp) for one in sent] == [k * TICK_NS for k in range(10)]
        assert [not one.name for one in sent] == [k == 0 or 4 <= k < 7 for k in range(10)]
        assert len(spread) == 10
        assert node.state.counts.pressures == 0


def test_a_controller_does_not_start_without_a_reading_of_each_chamber(domain):
    with active(ControllerNode) as node:
        for pressure, success in ((SILENT, False), (np.zeros(3), True)):
            now_ns, zero = node.get_clock().now().nanoseconds, np.zeros(3)
            receive(node, "chambers/state", messages.chambers(CHAMBERS, pressure, now_ns))
            receive(node, "arm/state", messages.arm_state(COORDINATES, zero, zero, zero, now_ns))
            found = [request(node, f"~/{name}") for name in ("enable_anyway", "enable")]
            assert [one.success for one in found] == [success] * 2
            if not success:
                assert all("no reading of link0/chamber1" in one.message for one in found)


def test_a_controller_that_has_no_readings_yet_commands_nothing_and_then_zero(domain):
    """`soro run` takes its first command for a sign that readings come, and enables it."""
    with active(ControllerNode) as node:
        sent, zero = captured(node, "chambers/command"), np.zeros(3)

        def estimate():
            q, now_ns = np.zeros(len(COORDINATES)), node.get_clock().now().nanoseconds
            receive(node, "arm/state", messages.arm_state(COORDINATES, q, q, q, now_ns))

        estimate()
        assert sent == []
        receive(node, "chambers/state", messages.chambers(CHAMBERS, zero, node.get_clock().now().nanoseconds))
        estimate()
        assert [list(one.effort) for one in sent] == [[0.0, 0.0, 0.0]]
        assert request(node, "~/enable").success


@pytest.mark.parametrize(("mode", "answers"), [("real_time", 0), ("lockstep", 1)])
def test_the_exciter_answers_no_partial_reading_in_real_time(domain, mode, answers):
    with active(ExciterNode, f"mode:={mode}", "pose_rate_hz:=200.0") as node:
        sent = captured(node, "chambers/command")
        tick(node, 0, SILENT)
        assert len(sent) == answers
        tick(node, 1, np.zeros(3))
        assert len(sent) == answers + 1
        assert all(np.isfinite(one.effort).all() for one in sent)


def test_what_is_read_is_finite():
    message = messages.chambers(CHAMBERS, SILENT, 0)
    for wrong in (np.nan, np.inf, -np.inf):
        message = JointState(name=list(CHAMBERS), effort=[0.0, wrong, wrong])
        with pytest.raises(ValueError, match="no reading of link0/chamber1, link0/chamber2"):
            messages.readings(message, CHAMBERS)
    assert messages.readings(messages.chambers(CHAMBERS, np.arange(3.0), 0), CHAMBERS).tolist() == [0, 1, 2]


def test_every_node_says_what_its_diagnostics_are_about(domain):
    with active(EstimatorNode) as node:
        fire(node, 1.0)
        assert node.diagnostics.status.hardware_id == "tue_three_bellow"
        assert values(node)["malformed"] == "0"
