"""A driver that was killed is followed by another one: the devices keep their errors, and still start."""

import time

import numpy as np
import pytest
from hardware_bench import (
    PATIENT,
    PERIOD_NS,
    Bench,
    RecordingBus,
    cycles_in_real_time,
    driver,
    driver_process,
    emergencies,
    emulator,
    platform,
    platform_file,
    single,
    ticks,
)

from soro_core.errors import HardwareError
from soro_hardware.canopen import frames, sdo_frames
from soro_hardware.canopen.cia408 import (
    ERROR_COMMUNICATION,
    ERROR_GENERIC,
    ERROR_REGISTER,
    ValveState,
)
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.canopen.frames import NmtCommand, NmtState
from soro_hardware.transport.frame import Frame
from tests.refused import fails

GUARDED = {"canopen": {"mapping": {"guarding": True}}}
RESET = "> 000 [2] 82 01"


def restarted(bench):
    """Another driver on the same bus, after its start-up."""
    bench.bus.take_log()
    bench.driver = CanopenRegulator(
        bench.platform, lambda: bench.bus, clock=lambda: time.monotonic(), lockstep=True
    )
    bench.driver.configure()
    return bench.bus.take_log()


def works(bench):
    """Whether the valve follows a set point, and reads it."""
    result = bench.run(100, 30e3)
    assert result.faults == ()
    assert result.fresh.all()
    np.testing.assert_allclose(bench.world.pressure_pa, 30e3, atol=600.0)


@pytest.mark.parametrize("options", [{}, GUARDED], ids=["heartbeat", "guarding"])
def test_after_a_killed_driver_another_one_starts(options):
    """The deadline of the set points stands as an error until the communication is reset."""
    bench = Bench(single(**options))
    bench.driver.configure()
    bench.run(100, 50e3)
    ticks(bench, 60)
    assert bench.world.nodes[0].state is NmtState.PRE_OPERATIONAL
    log = restarted(bench)
    assert RESET in log
    works(bench)


@pytest.mark.parametrize("options", [{}, GUARDED], ids=["heartbeat", "guarding"])
def test_an_error_that_a_sign_of_life_ends_needs_no_reset(options):
    bench = Bench(single(**options))
    bench.driver.configure()
    bench.run(100, 50e3)
    sent = ticks(bench, 60, Frame(0x201, bytes((7, 0)) + (5000).to_bytes(2, "little")))
    assert emergencies(sent) == ["8130"]
    node = bench.world.nodes[0]
    bench.send(frames.nmt(NmtCommand.START, 1))
    assert node.state is NmtState.PRE_OPERATIONAL, "the error keeps the node from OPERATIONAL"
    log = restarted(bench)
    assert RESET not in log
    works(bench)


def test_nodes_that_were_stopped_or_just_booted_need_no_reset():
    bench = Bench(single())
    assert RESET not in restarted(bench)
    bench.run(20, 30e3)
    bench.driver.close()
    assert bench.world.nodes[0].state is NmtState.STOPPED
    assert RESET not in restarted(bench)
    works(bench)


@pytest.mark.process
def test_a_driver_process_that_was_killed_is_followed_by_another(tmp_path):
    path = platform_file(tmp_path)
    with emulator(tmp_path, platform=path) as served:
        with driver_process(path, served.device):
            time.sleep(0.1)
        time.sleep(0.3)
        with driver(platform(**PATIENT), served.device, lockstep=False) as regulator:
            results = cycles_in_real_time(regulator, 0.3, np.array([20e3, 40e3, 60e3]))
    assert not [fault for result in results for fault in result.faults if fault.latched]
    np.testing.assert_allclose(results[-1].pressure_pa, [20e3, 40e3, 60e3], atol=2e3)


class SlowBus(RecordingBus):
    """The emulated bus with nodes that take their time: 10 ms for an answer; waiting makes time pass."""

    now_s = 0.0

    def __init__(self, platform):
        super().__init__(platform)
        self.heard = {}  # times of frames from the host, by identifier

    def send(self, msg, timeout=None):
        self.heard.setdefault(msg.arbitration_id, []).append(self.now_s)
        super().send(msg)
        if msg.arbitration_id >> 7 == sdo_frames.SDO_REQUEST >> 7:
            self.pass_time(0.01)

    def recv(self, timeout=None):
        if not self.frames and timeout:
            self.pass_time(timeout)
        return super().recv(timeout)

    def pass_time(self, seconds):
        """Let the devices' clock run on without SYNC."""
        before = list(self.frames)
        self.now_s += seconds
        self.world.tick(self.world.now_ns + round(seconds * 1e9))
        self.log += [f"< {frame}" for frame in list(self.frames)[len(before) :]]


def slow_start_up(platform, watch):
    """A driver that starts slow nodes which already watch the host, in real time of its own."""
    bus = SlowBus(platform)
    for node in bus.world.nodes:
        for (index, sub), value in watch.items():
            node.dictionary.override(index, sub, value)
    regulator = CanopenRegulator(platform, lambda: bus, clock=lambda: bus.now_s)
    regulator.configure()
    return bus, regulator


def test_the_hosts_heartbeat_comes_throughout_the_start_up():
    """Three slow nodes take seconds, and none of them misses the host for its 100 ms."""
    bus, regulator = slow_start_up(platform(watchdog_test=False), {(0x1016, 1): 127 << 16 | 100})
    assert bus.now_s > 2.0
    assert max(np.diff(bus.heard[0x77F])) < 0.05
    assert bus.now_s - bus.heard[0x77F][-1] < 0.1, "only the watches are armed after the last one"
    assert not [line for line in bus.log if line.startswith("< 08")], "no emergency"
    assert {node.state for node in bus.world.nodes} == {NmtState.OPERATIONAL}
    bus.pass_time(5.0)  # the first exchange may be any time later
    result = regulator.exchange(np.full(3, 20e3), 0)
    assert result.faults == ()


def test_limited_nodes_are_asked_throughout_the_start_up():
    bus, regulator = slow_start_up(
        platform(**GUARDED, watchdog_test=False), {(0x100C, 0): 25, (0x100D, 0): 4}
    )
    assert max(np.diff(bus.heard[0x701])) < 0.05
    assert not [line for line in bus.log if line.startswith("< 08")]
    bus.pass_time(5.0)
    assert regulator.exchange(np.full(3, 20e3), 0).faults == ()


def test_the_watch_is_armed_at_the_end_of_the_start_up():
    bench = Bench(single())
    bench.driver.configure()
    assert bench.world.nodes[0].dictionary.values[0x1016, 1] == 127 << 16 | 100
    bench.exchange(50e3)
    sent = ticks(bench, 30, Frame(0x201, bytes(4)))
    assert emergencies(sent) == ["8130"]
    assert bench.world.nodes[0].valve.state is ValveState.FAULT_DISABLED


def test_a_node_that_does_not_stay_operational_is_named():
    bench = Bench(single(canopen={"activation_timeout_s": 0.05}))
    node, receive = bench.world.nodes[0], bench.world.nodes[0].receive

    def receive_with_an_error_of_its_own(frame, now_ns):
        if frame.can_id == frames.NMT_ID and frame.data[0] == NmtCommand.START:
            node.dictionary.values[ERROR_REGISTER, 0] = ERROR_GENERIC | ERROR_COMMUNICATION
        else:
            receive(frame, now_ns)

    node.receive = receive_with_an_error_of_its_own
    with fails(
        HardwareError,
        "OPERATIONAL",
        "0x11",
        device="link0/chamber0 (node 1)",
        step="NMT start",
        code="refused",
    ):
        bench.driver.configure()


def test_the_first_watch_begins_with_the_first_exchange():
    bench = Bench(single())
    bench.driver.configure()
    bench.world.tick(bench.world.now_ns + 200 * PERIOD_NS)
    assert bench.run(20, 30e3).faults == ()
