"""Helpers of the hardware tests: drivers on emulated devices, in this process or in another one."""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import yaml

from soro_core.config import parse
from soro_hardware import Exchange, Platform, open_regulator
from soro_hardware.canopen import frames
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.driver import CanopenRegulator
from soro_hardware.emulation.canopen.world import World
from soro_hardware.emulation.sockets.plant_link import PlantFrame, PlantLinkClient
from soro_hardware.port import Regulator
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.link import from_message, to_message
from tests.patience import LATE_CYCLES, LIMIT_S
from tests.soro_hardware.hub_bus import HubBus
from tests.warm import Popen

PERIOD_NS = 5_000_000
TRANSCRIPTS = Path(__file__).parent / "transcripts"


# Three valves, with every value that the tests rely on; the shipped file may be tuned.
BASE: dict[str, Any] = {
    "family": "canopen_408",
    "transport": {"kind": "slcan"},
    "valves": [{"chamber": f"link0/chamber{n}", "node": n + 1} for n in range(3)],
    "range": {"minimum_pa": 0.0, "maximum_pa": 90e3},
    "cycle_hz": 200.0,
    "canopen": {
        "heartbeat_s": 0.025,
        "heartbeat_consumer_s": 0.1,
        "rpdo_deadline_s": 0.05,
        "stale_cycles": 3,
    },
    "regulator": {
        "delay_s": 0.005,
        "tau_s": 0.052,
        "hysteresis_pa": 900.0,
        "command_resolution_pa": 50.0,
        "reading_resolution_pa": 100.0,
        "reading_noise_pa": 100.0,
        "maximum_pa": 90e3,
    },
}

# Changes of it for a test in real time that asks for no fault.
PATIENT: dict[str, Any] = {"cycle_budget_s": 0.1, "canopen": LATE_CYCLES}


def platform(**changes: Any) -> CanopenPlatform:
    """The platform of the tests with some keys changed; nested keys as dictionaries are merged."""
    return parse(merged(BASE, changes), CanopenPlatform, where="test")


def transport(kind, **keys):
    """The way to the bus of a platform."""
    return platform(transport={"kind": kind, **keys}).transport


def platform_file(folder: Path, **changes: Any) -> str:
    """The same as a file."""
    path = folder / "platform.yaml"
    path.write_text(yaml.safe_dump(merged(BASE, changes)))
    return str(path)


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """A mapping with some keys changed; nested mappings are merged."""
    result = dict(base)
    for key, value in changes.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict)
        result[key] = merged(base[key], value) if both else value
    return result


ONE_VALVE = [{"chamber": "link0/chamber0", "node": 1}]


def single(**changes: Any) -> CanopenPlatform:
    """The same with one valve."""
    return platform(valves=ONE_VALVE, **changes)


class RecordingBus(HubBus):
    """Emulated bus in this process that writes down every frame in both directions, as they pass.

    The driver uses it as any bus of python-can, by `send` and `recv`.
    """

    send_frames = recv_frame = None

    def __init__(self, platform: CanopenPlatform, seed: int = 0) -> None:
        self.log: list[str] = []
        self.swallow: set[int] = set()  # identifiers that get lost on their way to the host
        self.drops_questions = False  # whether those of node guarding get lost on their way to the nodes
        super().__init__(platform, seed)
        self.frames.clear()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send and record, with what it causes."""
        if msg.is_remote_frame and self.drops_questions:
            return
        self.log.append(f"> {from_message(msg)}")
        before = len(self.frames)
        HubBus.send_frames(self, [from_message(msg)])
        arrived = list(self.frames)[before:]
        kept = [frame for frame in arrived if frame.can_id not in self.swallow]
        while len(self.frames) > before:
            self.frames.pop()
        self.frames.extend(kept)
        self.log += [f"< {frame}" for frame in arrived]

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, or None without waiting."""
        frame = HubBus.recv_frame(self, 0.0)
        return None if frame is None else to_message(frame)

    def inject(self, frame: Frame) -> None:
        """Let a frame arrive at the host."""
        self.frames.append(frame)

    def take_log(self) -> list[str]:
        """Everything since the last call."""
        log, self.log = self.log, []
        return log


class Bench:
    """A driver on emulated devices in this process, in lockstep."""

    def __init__(
        self, platform: CanopenPlatform, seed: int = 0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.platform = platform
        self.bus = RecordingBus(platform, seed)
        self.driver = CanopenRegulator(platform, lambda: self.bus, clock=clock, lockstep=True)
        self.cycle = 0

    @property
    def world(self) -> World:
        """The emulated devices."""
        return self.bus.world

    def exchange(self, *setpoints: float) -> Exchange:
        """One cycle; a single set point is for every chamber."""
        now_ns = self.cycle * PERIOD_NS
        self.cycle += 1
        return self.driver.exchange(np.full(self.driver.n_chambers, setpoints), now_ns)

    def run(self, cycles: int, *setpoints: float) -> Exchange:
        """Several cycles; the last one."""
        for _ in range(cycles):
            result = self.exchange(*setpoints)
        return result

    def send(self, frame: Frame) -> None:
        """Send a frame past the driver."""
        self.world.send(self.world.host, frame)

    def sdo(self, data: str, node: int = 1) -> str:
        """Raw SDO request and its answer, as hexadecimal bytes."""
        self.bus.frames.clear()
        self.send(Frame(0x600 + node, bytes.fromhex(data)))
        answers = [f.data.hex(" ").upper() for f in self.bus.frames if f.can_id == 0x580 + node]
        self.bus.frames.clear()
        return answers[0] if answers else ""


HOST_HEARTBEAT = frames.heartbeat(127, frames.NmtState.OPERATIONAL)


def ticks(bench: Bench, count: int, *also: Frame) -> list[Frame]:
    """SYNCs past the driver, each with some frames before it; everything that the nodes sent."""
    bench.bus.frames.clear()
    for _ in range(count):
        for frame in (*also, frames.SYNC):
            bench.send(frame)
    sent = list(bench.bus.frames)
    bench.bus.frames.clear()
    return sent


def emergencies(sent: list[Frame]) -> list[str]:
    """Codes of the emergencies of node 1 among some frames."""
    return [f"{int.from_bytes(f.data[:2], 'little'):04X}" for f in sent if f.can_id == 0x081]


def codes(result: Exchange) -> set[tuple[str, str]]:
    """Code and source of every fault."""
    return {(fault.code, fault.source) for fault in result.faults}


def set_points(log: list[str]) -> list[tuple[int, int, int]]:
    """Node, control word and set point of every RPDO in a log."""
    rpdos = [line.split() for line in log if line.startswith("> 20")]
    return [(int(r[1], 16) - 0x200, int(r[3], 16), int(r[6] + r[5], 16)) for r in rpdos]


def transcript(name: str) -> list[str]:
    """Lines of a recorded exchange; text after # explains."""
    lines = (TRANSCRIPTS / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in (raw.split("#")[0].rstrip() for raw in lines) if line]


class EmulatorProcess:
    """The emulator as a process of its own."""

    def __init__(self, folder: Path, *options: str, platform: str = "emulated_canopen") -> None:
        self.device = folder / "adapter"
        self.plant = folder / "plant"
        arguments = ["--device-link", str(self.device), "--plant-link", str(self.plant), *options]
        self.process = Popen(
            [sys.executable, "-m", "soro_hardware.emulation", platform, *arguments],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self.ready = self.process.stdout.readline().strip()

    def stop(self) -> int:
        """End it as a user would; its exit status."""
        self.process.terminate()
        return self.wait()

    def unplug(self) -> None:
        """End it at once, and take its links away: the number of a dead terminal goes to the next one."""
        self.process.kill()
        self.process.wait(LIMIT_S)
        for link in (self.device, *self.device.glob("*")):
            if link.is_symlink():
                link.unlink()

    def wait(self) -> int:
        """Wait for its end."""
        status = self.process.wait(LIMIT_S)
        if self.process.stdout is not None:
            self.process.stdout.close()
        return status


@contextlib.contextmanager
def emulator(folder: Path, *options: str, platform: str = "emulated_canopen") -> Iterator[EmulatorProcess]:
    """An emulator process that is gone afterwards, whatever happens."""
    served = EmulatorProcess(folder, *options, platform=platform)
    try:
        yield served
    finally:
        if served.process.poll() is None:
            served.process.kill()
        served.wait()


@contextlib.contextmanager
def driver(platform: Platform, endpoint: object, lockstep: bool = True) -> Iterator[Regulator]:
    """A configured driver that is closed afterwards."""
    regulator = open_regulator(platform, str(endpoint), lockstep=lockstep)
    try:
        regulator.configure()
        yield regulator
    finally:
        regulator.close()


# Sets 20, 40 and 60 kPa for ever.
_DRIVER = """
import sys, time
import numpy as np
from soro_hardware import load_platform, open_regulator
regulator = open_regulator(load_platform(sys.argv[1]), sys.argv[2])
regulator.configure()
print("running", flush=True)
while True:
    regulator.exchange(np.array([20e3, 40e3, 60e3]), time.monotonic_ns())
    time.sleep(0.005)
"""


@contextlib.contextmanager
def driver_process(platform_path: str, endpoint: object) -> Iterator[subprocess.Popen[bytes]]:
    """A driver of three chambers in a process of its own, killed at the end (SIGKILL)."""
    host = subprocess.Popen(
        [sys.executable, "-c", _DRIVER, platform_path, str(endpoint)], stdout=subprocess.PIPE
    )
    try:
        assert host.stdout is not None
        assert host.stdout.readline() == b"running\n"
        yield host
    finally:
        host.kill()
        host.wait(LIMIT_S)
        host.stdout.close()


def cycles_in_real_time(regulator: Regulator, seconds: float, target: Any) -> list[Exchange]:
    """Exchange at 200 Hz; the results."""
    results, end = [], time.monotonic() + seconds
    while (now := time.monotonic()) < end:
        results.append(regulator.exchange(target, time.monotonic_ns()))
        time.sleep(max(0.0, now + 0.005 - time.monotonic()))
    return results


def wait_for(condition: Callable[[], Any], limit_s: float = LIMIT_S) -> Any:
    """Poll until a condition holds; its value."""
    deadline = time.monotonic() + limit_s
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.005)
    raise AssertionError("the condition was not met in time")


def frames_until(
    link: PlantLinkClient, condition: Callable[[PlantFrame], Any], limit_s: float = LIMIT_S
) -> list[PlantFrame]:
    """Pressures of the chambers, in order, up to the first that meets a condition.

    Without a pause: frames that wait to be read would be taken for the present.
    """
    found, deadline = [link.receive(limit_s)], time.monotonic() + limit_s
    while not condition(found[-1]):
        assert time.monotonic() < deadline, "the condition was not met in time"
        found.append(link.receive(limit_s))
    return found


class Tap:
    """A second pseudo-terminal in front of an adapter, which records the bytes of both directions."""

    def __init__(self, device: Path) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._device = os.open(device, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._device)
        self._wake, self._stop = os.pipe()
        self.sent, self.received = b"", b""
        self._thread = threading.Thread(target=self._relay)

    def __enter__(self) -> Tap:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        os.write(self._stop, b".")
        self._thread.join()
        for descriptor in (self._master, self._slave, self._device, self._wake, self._stop):
            os.close(descriptor)

    def _relay(self) -> None:
        while True:
            ready, _, _ = select.select([self._master, self._device, self._wake], [], [])
            if self._master in ready:
                chunk = os.read(self._master, 4096)
                self.sent += chunk
                os.write(self._device, chunk)
            if self._device in ready:
                chunk = os.read(self._device, 4096)
                self.received += chunk
                os.write(self._master, chunk)
            if self._wake in ready:
                return
