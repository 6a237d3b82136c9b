"""Helpers of the tests of serial lines: drivers on emulated devices in this process, in lockstep."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from soro_hardware import Exchange
from soro_hardware.emulation.process import emulate
from soro_hardware.emulation.serial_line.devices import SerialDevices
from soro_hardware.emulation.serial_line.uart import Uart
from soro_hardware.families import parse_platform
from soro_hardware.serial_line.config import SerialPlatform
from soro_hardware.serial_line.dialects import AlicatRegulator, ItvRegulator
from soro_hardware.serial_line.driver import SerialRegulator
from soro_hardware.serial_line.line.engine import LineEngine
from soro_hardware.serial_line.line.port import BytePort
from soro_hardware.serial_line.lockstep import MARK, START_MARK
from tests.soro_hardware.line_link import LinePort

AIR = {
    "delay_s": 0.005,
    "tau_s": 0.052,
    "hysteresis_pa": 500.0,
    "command_resolution_pa": 0.0,
    "reading_resolution_pa": 100.0,
    "reading_noise_pa": 100.0,
    "maximum_pa": 90e3,
}
COMMON: dict[str, Any] = {
    "range": {"minimum_pa": 0.0, "maximum_pa": 90e3},
    "cycle_hz": 200.0,
    "line": {"check_s": 0.1},
    "regulator": AIR,
    "emulation": {"boot_delay_s": 0.0},
}
ITV: dict[str, Any] = {
    **COMMON,
    "family": "itv_rs232",
    "valves": [{"chamber": f"link0/chamber{n}"} for n in range(3)],
    "full_scale_pa": 100e3,
}
ALICAT: dict[str, Any] = {
    **COMMON,
    "family": "alicat",
    "valves": [{"chamber": f"link0/chamber{n}", "unit": "ABC"[n]} for n in range(3)],
    "baud": 115200,
}


def itv(n: int = 3, **changes: Any) -> SerialPlatform:
    """The ITV platform of the tests with `n` valves and some keys changed."""
    return _platform(ITV, n, changes)


def alicat(n: int = 3, **changes: Any) -> SerialPlatform:
    """The Alicat platform of the tests."""
    return _platform(ALICAT, n, changes)


def quiet(**emulation: Any) -> dict[str, Any]:
    """Keys of regulators without noise; the other keys are those of their emulation."""
    air = {**AIR, "reading_noise_pa": 0.0, "hysteresis_pa": 0.0}
    return {"regulator": air, "emulation": {"boot_delay_s": 0.0, **emulation}}


def _platform(base: dict[str, Any], n: int, changes: dict[str, Any]) -> SerialPlatform:
    found = parse_platform({**base, "valves": base["valves"][:n], **changes}, "test")
    assert isinstance(found, SerialPlatform)
    return found


class LoopPort(LinePort):
    """The host's end of an emulated line in this process; it writes down what passes."""

    def __init__(self, line: Uart, name: str) -> None:
        super().__init__(line, name)
        self.log: list[str] = []
        self._sent, self._received = b"", b""

    def read(self) -> bytes:
        """Bytes that have come."""
        chunk = super().read()
        self._received = self._note("< ", self._received + chunk.translate(None, MARK + START_MARK))
        return chunk

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._check()
        self._sent = self._note("> ", self._sent + data.translate(None, MARK + START_MARK))
        super().write(data)

    def close(self) -> None:
        """What has come stays; who opens it again gets this one."""
        self._is_lost = False

    def take_log(self) -> list[str]:
        """Lines in both directions since the last call."""
        log, self.log = self.log, []
        return log

    def _note(self, direction: str, data: bytes) -> bytes:
        *lines, rest = data.split(b"\r")
        texts = [line.decode("ascii", "backslashreplace").strip() for line in lines]
        self.log += [direction + text for text in texts if text]
        return rest


class SerialBench:
    """A driver on emulated devices in this process, in lockstep."""

    def __init__(self, platform: SerialPlatform, seed: int = 0) -> None:
        self.platform = platform
        devices = emulate(platform, lockstep=True, seed=seed)
        assert isinstance(devices, SerialDevices)
        self.devices = devices
        self.ports = [LoopPort(line, f"port{n}") for n, line in enumerate(devices.lines)]
        kind = ItvRegulator if platform.family == "itv_rs232" else AlicatRegulator
        self.driver: SerialRegulator = kind(platform, self._open, time.monotonic, lockstep=True)
        self.engines: list[LineEngine] = []  # of the last start-up
        self.driver.make_lines = partial(self._make_lines, self.driver.make_lines)
        self.cycle = 0
        self.period_ns = round(1e9 / platform.cycle_hz)

    @property
    def valves(self) -> Sequence[Any]:
        """The emulated devices."""
        return self.devices.valves

    def exchange(self, *setpoints: float) -> Exchange:
        """One cycle; a single set point is for every chamber."""
        self.cycle += 1
        values = np.full(self.driver.n_chambers, setpoints)
        return self.driver.exchange(values, self.cycle * self.period_ns)

    def run(self, cycles: int, *setpoints: float) -> Exchange:
        """Several cycles; the last one."""
        for _ in range(cycles):
            result = self.exchange(*setpoints)
        return result

    def log(self) -> list[str]:
        """What has passed on the lines since the last call, port after port."""
        return [entry for port in self.ports for entry in port.take_log()]

    def _make_lines(
        self, make: Callable[[Sequence[BytePort]], list[LineEngine]], ports: Sequence[BytePort]
    ) -> list[LineEngine]:
        self.engines = make(ports)
        return self.engines

    def _open(self) -> list[LoopPort]:
        return self.ports


def platform_file(folder: Path, platform: SerialPlatform) -> str:
    """A platform as a file."""
    path = folder / "platform.yaml"
    path.write_text(yaml.safe_dump(platform.model_dump(mode="json")))
    return str(path)
