"""Rates over the paced bus, in its own time: what twelve chambers can have at 1 Mbit/s, and what not."""

import math
from collections import deque

import can
import numpy as np
import pytest
from hardware_bench import platform

from soro_hardware.canopen.budget import highest_rate_hz
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.emulation.canopen.world import World
from soro_hardware.transport.link import from_message, to_message

SINGLES = [{"chamber": f"link{n // 3}/chamber{n % 3}", "node": n + 1} for n in range(12)]
QUADS = [{"chamber": f"link{n // 3}/chamber{n % 3}", "node": n // 4 + 1, "channel": n % 4} for n in range(12)]


class PacedBus(can.BusABC):
    """Host's end of an emulated bus on which frames take the time of their bits; waiting makes it pass."""

    def __init__(self, arm):
        self.channel_info, self._is_shutdown = "paced bus", True
        self._frames = deque()
        self.world = World(arm, self._frames.append, lockstep=False)

    def clock(self):
        """Time of the bus [s]."""
        return self.world.now_ns * 1e-9

    def send(self, msg, timeout=None):
        self.world.send(self.world.host, from_message(msg))

    def recv(self, timeout=None):
        end_ns = self.world.now_ns + math.ceil((timeout or 0.0) * 1e9)
        while not self._frames and self.world.now_ns < end_ns:
            self.world.run(min(self.world.next_event_ns, end_ns))
        return to_message(self._frames.popleft()) if self._frames else None

    def wait(self, until_s):
        """Let time pass."""
        until_ns = round(until_s * 1e9)
        while self.world.now_ns < until_ns:
            self.world.run(min(self.world.next_event_ns, until_ns))


def arm(valves, **canopen):
    budget_s = 0.1
    return platform(valves=valves, cycle_budget_s=budget_s, emulation={"boot_delay_s": 0.0}, canopen=canopen)


def driven(described):
    bus = PacedBus(described)
    driver = CanopenRegulator(described, lambda: bus, clock=bus.clock)
    driver.configure()
    return bus, driver


LAYOUTS = {
    "12 nodes of one valve": (SINGLES, {}, 250.0, 428.3),
    "12 guarded nodes": (SINGLES, {"mapping": {"guarding": True}}, 250.0, 428.3),
    "3 nodes of four valves": (QUADS, {"mapping": {"device": "cia408_4ch"}}, 500.0, 1156.1),
}


@pytest.mark.parametrize(("valves", "canopen", "rate_hz", "_"), LAYOUTS.values(), ids=LAYOUTS.keys())
def test_no_answer_is_lost_at_the_planned_rate(valves, canopen, rate_hz, _):
    bus, driver = driven(arm(valves, **canopen))
    start_s, cycles = bus.clock(), 250
    for cycle in range(cycles):
        due_s = start_s + cycle / rate_hz
        assert bus.clock() <= due_s + 0.1 / rate_hz, "every cycle is over before the next one is due"
        bus.wait(due_s)
        result = driver.exchange(np.full(12, 40e3), bus.world.now_ns)
        assert result.faults == ()
        assert result.fresh.all()
    assert driver.statistics.frames_lost == 0


@pytest.mark.parametrize(("valves", "canopen", "_", "limit_hz"), LAYOUTS.values(), ids=LAYOUTS.keys())
def test_no_rate_beyond_the_bits_of_the_bus(valves, canopen, _, limit_hz):
    """Back to back, with a host that needs no time of its own."""
    described = arm(valves, **canopen)
    bus, driver = driven(described)
    start_ns, cycles = bus.world.now_ns, 200
    for _cycle in range(cycles):
        assert driver.exchange(np.full(12, 40e3), bus.world.now_ns).fresh.all()
    rate_hz = cycles / ((bus.world.now_ns - start_ns) * 1e-9)
    assert highest_rate_hz(described) == pytest.approx(limit_hz, abs=0.1)
    assert 0.85 * limit_hz < rate_hz < limit_hz, "heartbeats and status words take the rest"
