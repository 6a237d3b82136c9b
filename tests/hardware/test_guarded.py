"""A regulator behind the limiter: what the regulator node, `soro hil` and the fault matrix run."""

import time

import numpy as np
from hardware_bench import platform

from soro_core import safety
from soro_core.hardware.canopen.driver import CanopenRegulator
from soro_core.hardware.emulation.faults import read_injection
from soro_core.hardware.emulation.inprocess import HubBus
from soro_core.hardware.guarded import GuardedRegulator


class Guarded:
    """Emulated CANopen valves behind the limiter, in lockstep."""

    def __init__(self, **limits) -> None:
        self.platform = platform(canopen={"boot_timeout_s": 0.2})
        self.bus = HubBus(self.platform, seed=1)
        self.driver = CanopenRegulator(self.platform, lambda: self.bus, time.monotonic, lockstep=True)
        self.driver.configure()
        self.loop = GuardedRegulator(self.platform, self.driver, safety.Limits(**limits))
        self.now_ns = 0

    def run(self, seconds: float, command_pa: float) -> None:
        for _ in range(round(seconds * self.platform.cycle_hz)):
            self.loop.offer(np.full(3, command_pa), self.now_ns, self.now_ns)
            self.loop.cycle(self.now_ns)
            self.now_ns += round(1e9 / self.platform.cycle_hz)

    def reset(self) -> str | None:
        return self.loop.reset(lambda: self.now_ns)

    def inject(self, text: str) -> None:
        self.bus.world.faults.add(read_injection(f"fault: {text}"))


def test_a_reset_takes_devices_with_any_fault_through_their_start_up_or_says_why_not():
    """A silent one is no latched fault of the driver, and may have lost anything meanwhile."""
    it = Guarded()
    it.run(0.5, 40e3)
    it.inject("mute, chamber: link0/chamber1")
    it.run(0.03, 40e3)
    assert it.loop.cause.startswith("stale_reading: link0/chamber1")
    it.run(0.02, 0.0)  # shorter than the time after which its heartbeat is lost
    refusal = it.reset()
    assert refusal is not None
    assert "link0/chamber1 (node 2): boot: no answer" in refusal
    assert it.loop.state.vented
    it.bus.world.faults.clear()
    assert it.reset() is None
    it.run(0.5, 40e3)
    assert it.loop.cause is None
    np.testing.assert_allclose(it.bus.world.pressure_pa, 40e3, atol=2e3)


def test_a_start_up_that_takes_long_loses_no_command():
    """Nobody could command while the reset waited for the devices."""
    it = Guarded()
    it.run(0.1, 0.0)
    it.inject("reboot, chamber: link0/chamber1")
    it.run(0.1, 0.0)
    assert "rebooted" in it.loop.cause
    configure = it.driver.configure

    def slowly() -> None:
        configure()
        it.now_ns += 2_000_000_000

    it.driver.configure = slowly
    assert it.reset() is None
    it.loop.cycle(it.now_ns)
    assert it.loop.cause is None
