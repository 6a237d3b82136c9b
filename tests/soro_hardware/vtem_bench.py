"""Helpers of the tests of the motion terminal: platform, and a driver on an emulated one."""

from __future__ import annotations

import time
from typing import Any

from board_bench import COMMON, Bench, RecordingLink
from hardware_bench import merged

from soro_core.config import parse
from soro_hardware.emulation.vtem import EmulatedTerminal
from soro_hardware.vtem.config import VtemPlatform
from soro_hardware.vtem.driver import VtemRegulator

PLACES = ((0, 0), (0, 1), (2, 1))
# Slot 1 feeds nothing, and of slot 2 only the second valve is used.
VTEM: dict[str, Any] = {
    **COMMON,
    "family": "vtem_modbus",
    "transport": {"kind": "tcp", "port": 502},
    "valves": [
        {"chamber": f"link0/chamber{n}", "slot": slot, "valve": valve}
        for n, (slot, valve) in enumerate(PLACES)
    ],
    "host": {"stale_cycles": 3, "start_timeout_s": 2.0},
    "emulation": {"boot_s": 0.05, "app_start_s": 0.05},
}


def vtem_platform(**changes: Any) -> VtemPlatform:
    """The terminal of the tests with some keys changed."""
    return parse(merged(VTEM, changes), VtemPlatform, "test")


class VtemBench(Bench):
    """The terminal in this process, in lockstep."""

    devices: EmulatedTerminal
    driver: VtemRegulator

    def __init__(self, platform: VtemPlatform, seed: int = 0, there: VtemPlatform | None = None) -> None:
        """`there` is the terminal, where it is another one than the driver's platform describes."""
        self.devices = EmulatedTerminal(there or platform, lockstep=True, seed=seed)
        super().__init__(RecordingLink(self.devices.line))
        self.driver = VtemRegulator(platform, self.link, time.monotonic, lockstep=True)
