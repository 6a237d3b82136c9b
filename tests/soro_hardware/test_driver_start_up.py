"""The CANopen driver in lockstep: start-up errors name device and step."""

import numpy as np
import pytest
from hardware_bench import PERIOD_NS, Bench, platform, single

from soro_core.errors import HardwareError
from soro_hardware.canopen import frames
from soro_hardware.canopen.cia408 import ValveState
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.canopen.frames import NmtState
from tests.refused import fails

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
    elif what == "forgets":
        dictionary.on_read[0x6394, 1] = lambda: 7
    elif what == "map":
        dictionary.on_read[0x1600, 2] = lambda: 0x63000110
    elif what == "stuck":
        dictionary.on_write[0x6040, 0] = lambda _: None


STARTUP = {
    "profile": ("device type", "401", "408"),
    "unit": ("units", "0x33"),
    "coarse": ("units", "100000 Pa"),
    "no limit": ("limits", "63A0:1 = 9000", "0x06020000"),
    "forgets": ("hold set point", "6394:1 = 0", "7"),
    "map": ("mapping 1600", "1600:2 = 1669333264", "1660944656"),
    "stuck": ("state machine to hold", "control word 1", "disabled", "init"),
}


@pytest.mark.parametrize(("what", "found"), STARTUP.items(), ids=STARTUP.keys())
def test_start_up_error_names_device_and_step(what, found):
    bench = Bench(platform(canopen=QUICK))
    sabotage(bench.world.nodes[1], what)
    step, *names = found
    with fails(HardwareError, *names, device="link0/chamber1 (node 2)", step=step, code="refused"):
        bench.driver.configure()
    with fails(HardwareError, code="order"):
        bench.exchange(0.0)
    bench.driver.vent()
    bench.driver.close()
    assert bench.world.pressure_pa.max() == 0.0


def test_absent_node():
    bench = Bench(platform(canopen=QUICK))
    bench.bus.swallow = {0x582}
    with fails(HardwareError, "0.01 s", device="link0/chamber1 (node 2)", step="boot", code="silent"):
        bench.driver.configure()


def test_wrong_identity():
    bench = Bench(single(canopen={"product_code": 0x1234}))
    with fails(HardwareError, "0x408", "0x1234", step="identity", code="refused"):
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


@pytest.mark.parametrize("every", [2, 3, 7])
def test_a_late_sdo_answer_is_not_taken_for_that_of_a_later_request(every):
    """The request is repeated and answered twice; one that writes is followed by one that reads the same."""
    bench = Bench(single(canopen={"sdo_timeout_s": 0.01}))
    answers, late = [], []

    def recv(timeout=None):
        if late:
            return late.pop()
        message = type(bench.bus).recv(bench.bus, timeout)
        if message is None or message.arbitration_id != 0x581:
            return message
        answers.append(message)
        if len(answers) % every:
            return message
        late.append(message)
        return None

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
    with fails(HardwareError, device="link0/chamber0 (node 1)", code="refused"):
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
    assert {node.valve.state for node in arm.world.nodes} == {ValveState.HOLD}
    result = driver.exchange(np.full(3, 10e3), 50 * PERIOD_NS)
    assert result.faults == ()
    assert result.fresh.all()
