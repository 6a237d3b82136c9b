"""Emulated devices of any family in a thread of this process, over their real bytes."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

from soro_hardware import Platform
from soro_hardware.emulation.process import Emulator, emulate


@contextlib.contextmanager
def served(platform: Platform, lockstep: bool = False) -> Iterator[tuple[Any, str]]:
    """Devices in real time, or in the host's, and the address to open."""
    devices = emulate(platform, lockstep, seed=0)
    with Emulator(devices) as emulator:
        thread = threading.Thread(target=emulator.run, args=(time.monotonic_ns,))
        thread.start()
        try:
            yield devices, emulator.address
        finally:
            emulator.stop()
            emulator.wake()
            thread.join()
