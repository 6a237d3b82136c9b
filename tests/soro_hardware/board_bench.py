"""Helpers of the tests of `soro board` and of the VEAB server: platforms, and drivers on emulated devices."""

from __future__ import annotations

import socket
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from hardware_bench import PERIOD_NS, merged

from soro_hardware import Exchange
from soro_hardware.board import frames, messages
from soro_hardware.board.config import BoardPlatform
from soro_hardware.board.driver import BoardRegulator
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.emulation.board.board import EmulatedBoard
from soro_hardware.emulation.devices import EmulatedDevices
from soro_hardware.emulation.veab import EmulatedVeabServer
from soro_hardware.families import parse_platform
from soro_hardware.port import Regulator
from soro_hardware.veab.config import VeabPlatform
from soro_hardware.veab.driver import VeabRegulator
from tests.soro_hardware.line_link import LineLink

AIR = {
    "delay_s": 0.005,
    "tau_s": 0.052,
    "hysteresis_pa": 900.0,
    "command_resolution_pa": 0.0,
    "reading_resolution_pa": 0.0,
    "reading_noise_pa": 100.0,
    "minimum_pa": -100e3,
    "maximum_pa": 100e3,
}
QUIET = {"regulator": {"reading_noise_pa": 0.0}}
COMMON: dict[str, Any] = {
    "valves": [{"chamber": f"link0/chamber{n}", "port": n} for n in range(3)],
    "range": {"minimum_pa": 0.0, "maximum_pa": 90e3},
    "cycle_hz": 200.0,
    "regulator": AIR,
}
VEAB_SCALE = {"output": [[0.0, -100e3], [10.0, 100e3]], "input": [[0.0, -100e3], [10.0, 100e3]]}
# Two boards, four ports: the fourth feeds no chamber.
BOARD: dict[str, Any] = {
    **COMMON,
    "family": "soro_board",
    "transport": {"kind": "tcp", "port": 8889},
    "scales": {"veab": VEAB_SCALE},
    "ports": [
        {"bus": bus, "dac": 0x60 + n, "adc": 0x48 + n, "scale": "veab"} for bus in (1, 3) for n in (0, 1)
    ],
    "board": {"watchdog_s": 0.1, "heartbeat_s": 0.025, "tolerated_errors": 3},
    "host": {"heartbeat_consumer_s": 0.1, "stale_cycles": 3},
}
VEAB: dict[str, Any] = {
    **COMMON,
    "family": "veab_tcp",
    "transport": {"kind": "tcp", "port": 8888},
    "ports": 4,
    "host": {"keep_alive_s": 0.1, "vented_pa": 5e3, "vent_timeout_s": 2.0, "stale_cycles": 5},
}
ONE_VALVE = [{"chamber": "link0/chamber0", "port": 0}]


def board_platform(**changes: Any) -> BoardPlatform:
    """The board of the tests with some keys changed."""
    platform = parse_platform(merged(BOARD, changes), "test")
    assert isinstance(platform, BoardPlatform)
    return platform


def veab_platform(**changes: Any) -> VeabPlatform:
    """The VEAB server of the tests with some keys changed."""
    platform = parse_platform(merged(VEAB, changes), "test")
    assert isinstance(platform, VeabPlatform)
    return platform


def itv(**changes: Any) -> BoardPlatform:
    """The board with regulators of 0 to 10 V whose monitor gives 1 to 5 V, as an SMC ITV2050."""
    scale = {"output": [[0.0, 0.0], [10.0, 900e3]], "input": [[1.0, 0.0], [5.0, 900e3]]}
    ports = [{**port, "scale": "itv"} for port in BOARD["ports"]]
    base = {"scales": {"itv": scale}, "ports": ports, "range": {"maximum_pa": 500e3}}
    base["regulator"] = {"minimum_pa": 0.0, "maximum_pa": 900e3}
    base["rating"] = {"maximum_pa": 1e6}
    return board_platform(**merged(base, changes))


def file_of(folder: Path, base: dict[str, Any], **changes: Any) -> str:
    """A platform as a file."""
    path = folder / f"{base['family']}.yaml"
    path.write_text(yaml.safe_dump(merged(base, changes)))
    return str(path)


def greeted(host: socket.socket, ports: int = 4) -> int:
    """Greet a board over a connection of the test's own; the number of its welcome."""
    host.sendall(frames.encode(BoardFrame(FrameType.HELLO, 0, messages.pack_hello(ports))))
    decoder, found = frames.BoardFrameDecoder(messages.lengths(ports)), []
    while not found:
        found = decoder.feed(host.recv(4096))
    assert found[0].kind is FrameType.WELCOME
    return found[0].number


class RecordingLink(LineLink):
    """A link that writes down the bytes of both directions."""

    def __init__(self, line: Any) -> None:
        super().__init__(line)
        self.log: list[tuple[str, bytes]] = []

    def send(self, data: bytes) -> None:
        super().send(data)
        self.log.append((">", data))

    def receive(self, timeout_s: float) -> bytes:
        chunk = super().receive(timeout_s)
        if chunk:
            self.log.append(("<", chunk))
        return chunk

    def take_log(self) -> list[tuple[str, bytes]]:
        """Everything since the last call."""
        log, self.log = self.log, []
        return log


def lines(log: list[tuple[str, bytes]]) -> list[str]:
    """A log as the transcripts have it."""
    return [f"{mark} {data.hex(' ').upper()}" for mark, data in log]


class Bench:
    """A driver on emulated devices in this process, in lockstep."""

    devices: EmulatedDevices
    driver: Regulator

    def __init__(self, link: RecordingLink) -> None:
        self.link, self.cycle = link, 0

    def exchange(self, *setpoints: float) -> Exchange:
        """One cycle; a single set point is for every chamber."""
        self.cycle += 1
        return self.driver.exchange(np.full(self.driver.n_chambers, setpoints), self.cycle * PERIOD_NS)

    def run(self, cycles: int, *setpoints: float) -> Exchange:
        """Several cycles; the last one."""
        for _ in range(cycles):
            result = self.exchange(*setpoints)
        return result


class BoardBench(Bench):
    """The board."""

    def __init__(self, platform: BoardPlatform, seed: int = 0) -> None:
        self.devices = EmulatedBoard(platform, lockstep=True, seed=seed)
        self.devices.board.draw = lambda: 0x1122334455667788  # as the transcripts have it
        super().__init__(RecordingLink(self.devices.line))
        self.driver = BoardRegulator(platform, self.link, time.monotonic, lockstep=True)


class VeabBench(Bench):
    """The published server."""

    def __init__(self, platform: VeabPlatform, seed: int = 0) -> None:
        self.devices = EmulatedVeabServer(platform, lockstep=True, seed=seed)
        super().__init__(RecordingLink(self.devices.line))
        self.driver = VeabRegulator(platform, self.link, time.monotonic, lockstep=True)

    def restart(self) -> None:
        """The server ends and is started again by hand."""
        self.devices.end("killed")
        self.devices.start()
