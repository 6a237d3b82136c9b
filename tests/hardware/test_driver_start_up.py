"""The CANopen driver in lockstep: start-up errors name device and step."""

import numpy as np
import pytest
from hardware_bench import PERIOD_NS, Bench, platform, single

from soro_core.errors import HardwareError
from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.cia408 import State
from soro_core.hardware.canopen.driver import CanopenRegulator
from soro_core.hardware.canopen.frames import NmtState

QUICK = {"boot_timeout_s": 0.01, "sdo_timeout_s": 0.01, "sdo_retries": 1, "activation_timeout_s": 0.05}


def sabotage(node, what):
    """Make one device wrong."""
    dictionary = node.dictionary
    if what == "profile":
        dictionary.values[0x1000, 0] = 401
    elif what == "unit":
        dictionary.values[0x6380, 2] = 0x33
    elif what == "coarse":
        dictionary.values[0x6380, 3] = 5
    elif what == "no limit":
        for key in [key for key in dictionary.entries if key[0] == 0x63A0]:
            del dictionary.entries[key]
        dictionary._indices.discard(0x63A0)
    elif what == "forgets":
        dictionary.on_read[0x6394, 1] = lambda: 7
    elif what == "map":
        dictionary.on_read[0x1600, 2] = lambda: 0x63000110
    elif what == "stuck":
        dictionary.on_write[0x6040, 0] = lambda _: None


STARTUP = {
    "profile": r"device type: the device has profile 401, not 408",
    "unit": r"units: unit 0x33",
    "coarse": r"units: one count is 100000 Pa",
    "no limit": r"limits: SDO write 63A0:1 = 9000 refused: 0x06020000 no object",
    "forgets": r"hold set point: wrote 6394:1 = 0, the device has 7",
    "map": r"mapping 1600: wrote 1600:2 = 1669333264, the device has 1660944656",
    "stuck": r"state machine to hold: control word 1 does not lead to disabled, found init",
}


@pytest.mark.parametrize(("what", "text"), STARTUP.items(), ids=STARTUP.keys())
def test_start_up_error_names_device_and_step(what, text):
    bench = Bench(platform(canopen=QUICK))
    sabotage(bench.world.nodes[1], what)
    with pytest.raises(HardwareError, match=rf"^link0/chamber1 \(node 2\): {text}"):
        bench.driver.configure()
    with pytest.raises(HardwareError, match="before configure"):
        bench.exchange(0.0)
    bench.driver.vent()
    bench.driver.close()
    assert bench.world.pressure_pa.max() == 0.0


def test_absent_node():
    bench = Bench(platform(canopen=QUICK))
    bench.bus.swallow = {0x582}
    with pytest.raises(HardwareError, match=r"^link0/chamber1 \(node 2\): boot: no answer for 0.01 s"):
        bench.driver.configure()


def test_wrong_identity():
    bench = Bench(single(canopen={"product_code": 0x1234}))
    with pytest.raises(HardwareError, match="identity: product 0x408, the platform asks for 0x1234"):
        bench.driver.configure()


def test_lost_sdo_answer_is_retried():
    bench = Bench(single(canopen={"sdo_timeout_s": 0.01}))
    answers = []

    def recv(timeout=None):
        message = type(bench.bus).recv(bench.bus, timeout)
        if message is None or message.arbitration_id != 0x581:
            return message
        answers.append(message)
        return None if len(answers) in (8, 9, 40) else message

    bench.bus.recv = recv
    bench.driver.configure()
    assert len(answers) > 40
    assert bench.exchange(20e3).faults == ()


def test_reboot_during_start_up():
    bench = Bench(single())
    node = bench.world.nodes[0]
    send = bench.bus.send

    def reboot_after_limits(message, timeout=None):
        send(message)
        if bytes(message.data[:4]) == bytes.fromhex("2B A0 63 01"):
            node.reset(bench.world.now_ns)

    bench.bus.send = reboot_after_limits
    with pytest.raises(HardwareError, match=r"link0/chamber0 \(node 1\): .*(booted again|the device has)"):
        bench.driver.configure()


def test_heartbeat_from_before_nmt_start_is_no_fault():
    bench = Bench(single())
    send = bench.bus.send

    def with_heartbeat(message, timeout=None):
        send(message)
        if bytes(message.data[:4]) == bytes.fromhex("2B A0 63 01"):
            bench.bus.inject(frames.heartbeat(1, NmtState.PRE_OPERATIONAL))

    bench.bus.send = with_heartbeat
    bench.driver.configure()
    assert bench.run(3, 20e3).faults == ()


def test_start_up_over_a_running_session(arm):
    """A second driver takes over valves that a killed one has left ACTIVE."""
    driver = CanopenRegulator(arm.platform, lambda: arm.bus, clock=lambda: 0.0, lockstep=True)
    driver.configure()
    assert {node.valve.state for node in arm.world.nodes} == {State.HOLD}
    result = driver.exchange(np.full(3, 10e3), 50 * PERIOD_NS)
    assert result.faults == ()
    assert result.fresh.all()
