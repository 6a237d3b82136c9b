"""Answers that are lost in lockstep are known at once: a run does not crawl, whatever the machine does."""

import time

import pytest
from hardware_bench import driver, platform
from served_bench import served

from soro_hardware.emulation.faults.fault_types import read_injection

ADAPTERS = [{"kind": "slcan"}, {"kind": "socketcand"}]
# A single lost answer that is waited for ends the test.
FOREVER = {"lockstep_timeout_s": 60.0, "canopen": {"stale_cycles": 100, "stale_s": 0.5}}
pytestmark = pytest.mark.timeout(120)


def fresh(transport, fault, cycles=200, pause_s=0.0):
    """Which answers came in each cycle; now and then the emulator's side is held up."""
    described = platform(transport=transport, **FOREVER)
    with served(described, lockstep=True) as (devices, address), driver(described, address) as regulator:
        devices.faults.add(read_injection(fault))
        take = devices.lines[0].take

        def hold_up(chunk):
            time.sleep(pause_s if devices.ticks % 40 == 0 else 0.0)
            take(chunk)

        devices.lines[0].take = hold_up
        rows = []
        try:
            for cycle in range(cycles):
                exchange = regulator.exchange([20e3, 40e3, 60e3], cycle * 5_000_000)
                rows.append(tuple(exchange.fresh.tolist()))
        finally:
            devices.faults.clear()
        return rows, regulator.statistics.frames_lost


@pytest.mark.process
@pytest.mark.parametrize("transport", ADAPTERS, ids=["slcan", "socketcand"])
def test_what_is_lost_is_not_waited_for_and_the_same_every_time(transport):
    rows, lost = fresh(transport, "{fault: drop, p: 0.05}")
    assert 0.02 < lost / (3 * len(rows)) < 0.2
    assert fresh(transport, "{fault: drop, p: 0.05}", pause_s=0.05) == (rows, lost)


@pytest.mark.process
@pytest.mark.parametrize("transport", ADAPTERS, ids=["slcan", "socketcand"])
def test_a_silent_node_holds_nothing_up(transport):
    rows, lost = fresh(transport, "{fault: mute, chamber: link0/chamber1}", cycles=20)
    assert rows == [(True, False, True)] * 20
    assert lost == 20


def test_acknowledgements_that_are_lost_too_are_waited_for_once():
    """A line that cuts messages: the adapter's own time is the limit, and the next loss is known at once."""
    slow = {"kind": "slcan", "open_timeout_s": 0.2}
    described = platform(transport=slow, **{**FOREVER, "lockstep_timeout_s": 0.3})
    with served(described, lockstep=True) as (devices, address), driver(described, address) as regulator:
        regulator.exchange([0.0] * 3, 0)
        line = devices.lines[0]
        to_host, line.to_host = line.to_host, lambda chunk: b""
        assert not regulator.exchange([0.0] * 3, 5_000_000).fresh.any()
        line.to_host = to_host
        while regulator.link.bus.recv_frame(600.0) is not None:  # waits for what is still to come
            pass
        assert regulator.exchange([0.0] * 3, 10_000_000).fresh.all()
