"""The emulator as a process: lines to the host, a socket as plant link, one loop around both."""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

from soro_core.errors import HardwareError
from soro_core.hardware.emulation.control import ControlServer
from soro_core.hardware.emulation.devices import EmulatedDevices
from soro_core.hardware.emulation.endpoints import ENDPOINTS, PtyEndpoint, TcpEndpoint
from soro_core.hardware.emulation.faults import Injection
from soro_core.hardware.emulation.plant_server import PlantLinkServer
from soro_core.hardware.families import FAMILIES
from soro_core.hardware.platform import PlatformBase
from soro_core.hardware.reason import reason


class Emulator:
    """Emulated devices of any family, served to a host.

    Parameters
    ----------
    devices : EmulatedDevices
        What is served.
    lockstep : bool
        Whether the host advances the devices, or the time given to `run`.
    device_link : Path, optional
        Name to make for the line: a symbolic link to its pseudo-terminal (or, for TCP, one that reads as its
        address). For several lines it is a folder of links 0, 1, ... An older link is replaced.
    plant_link : Path, optional
        Unix socket to a twin, see `soro_core.hardware.plant_link`.
    control : Path, optional
        Unix socket on which faults are taken.

    Raises
    ------
    HardwareError
        If a link or the socket cannot be made.
    """

    def __init__(
        self,
        devices: EmulatedDevices,
        lockstep: bool,
        device_link: Path | None = None,
        plant_link: Path | None = None,
        control: Path | None = None,
    ) -> None:
        self.devices = devices
        self._lockstep = lockstep
        self._stopped = False
        self._clock: Callable[[], int] = lambda: 0
        self._start_ns = 0
        # select() waits with microseconds; epoll and poll round up to milliseconds, longer than ten frames.
        self._selector = selectors.SelectSelector()
        self._wake = os.pipe()
        os.set_blocking(self._wake[1], False)
        self._selector.register(self._wake[0], selectors.EVENT_READ, self._woken)
        self.on_wake: Callable[[], None] = lambda: None
        self._plant: PlantLinkServer | None = None
        self._links: dict[Path, str] = {}
        self._device_link = device_link
        self._control: ControlServer | None = None
        self._endpoints: list[PtyEndpoint | TcpEndpoint] = []
        # Changed at the head of a turn: a fault begins in the midst of one, with the line in use.
        self._plugged = True
        devices.faults.on_start["adapter_unplug"] = lambda _: self._set_plugged(False)
        devices.faults.on_end["adapter_unplug"] = lambda _: self._set_plugged(True)
        try:
            if control is not None:
                self._control = ControlServer(control, devices.faults, self._selector)
            if plant_link is not None:
                self._plant = PlantLinkServer(
                    plant_link, lambda: devices.pressure_pa, self._selector, lockstep
                )
                devices.on_tick = self._plant.publish
                devices.connect_plant(self._plant.pressures)
            self._plug()
        except HardwareError:
            self.close()
            raise

    @property
    def address(self) -> str:
        """What the host opens: one path or address for each line, with commas between them."""
        return ",".join(endpoint.address for endpoint in self._endpoints)

    def run(self, clock: Callable[[], int]) -> None:
        """Serve until `stop`; `clock` gives a monotonic time [ns]."""
        self._clock, self._start_ns = clock, clock()
        while not self._stopped:
            if self._plugged != bool(self._endpoints):
                (self._plug if self._plugged else self._unplug)()
            timeout = None
            if not self._lockstep:
                # What the process was held up stays a hole in the world's time.
                self._start_ns += self.devices.run(self._now_ns())
                timeout = max((self.devices.next_event_ns - self._now_ns()) * 1e-9, 0.0)
            self._write()
            for key, _ in self._selector.select(timeout):
                key.data()

    @property
    def wake_descriptor(self) -> int:
        """Where a byte written wakes `run` up, as the interpreter does for a signal."""
        return self._wake[1]

    def wake(self) -> None:
        """Let `run` call `on_wake` and look whether it has been stopped; from any thread."""
        os.write(self._wake[1], b".")

    def stop(self) -> None:
        """End `run` after the present turn; may be called from a signal handler."""
        self._stopped = True

    def close(self) -> None:
        """Take away what the constructor made."""
        self._unplug()
        for server in (self._plant, self._control):
            if server is not None:
                server.close()
        self._selector.close()
        for descriptor in self._wake:
            os.close(descriptor)

    def __enter__(self) -> Emulator:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _woken(self) -> None:
        os.read(self._wake[0], 64)
        self.on_wake()

    def _now_ns(self) -> int:
        return self._clock() - self._start_ns

    def _before_input(self) -> None:
        if not self._lockstep:
            self.devices.run(self._now_ns())  # bytes are taken at the time at which they came

    def _write(self) -> None:
        for endpoint in self._endpoints:
            endpoint.write()
            # In lockstep nothing may be lost: wait for the host.
            while self._lockstep and endpoint.line.output and not self._stopped:
                endpoint.wait_writable(0.1)
                endpoint.write()

    def _set_plugged(self, plugged: bool) -> None:
        self._plugged = plugged

    def _plug(self) -> None:
        self._endpoints = [
            ENDPOINTS[line.transport or self.devices.transport](line, self._selector, self._before_input)
            for line in self.devices.lines
        ]
        if self._device_link is not None:
            self._link_all(self._device_link)

    def _unplug(self) -> None:
        """Take the lines away from the host, and their names with them."""
        for link, target in self._links.items():
            if link.is_symlink() and os.readlink(link) == target:
                link.unlink()
        for folder in {link.parent for link in self._links} if len(self._links) > 1 else ():
            with contextlib.suppress(OSError):
                folder.rmdir()
        self._links.clear()
        endpoints, self._endpoints = self._endpoints, []
        for endpoint in endpoints:
            endpoint.close()
            endpoint.line.output.clear()

    def _link_all(self, name: Path) -> None:
        try:
            links = [name]
            if len(self._endpoints) > 1:
                if name.is_symlink():  # left by an emulator of one line that was killed
                    name.unlink()
                name.mkdir(exist_ok=True)
                links = [name / str(number) for number in range(len(self._endpoints))]
            for link, endpoint in zip(links, self._endpoints, strict=True):
                if link.is_symlink():
                    link.unlink()
                link.symlink_to(endpoint.address)
                self._links[link] = endpoint.address
        except OSError as error:
            raise HardwareError(f"{name}: cannot link to the emulated line ({reason(error)})") from None


def serve(
    platform: PlatformBase,
    clock: Callable[[], int],
    announce: Callable[[str], None],
    lockstep: bool = False,
    device_link: Path | None = None,
    plant_link: Path | None = None,
    seed: int = 0,
    control: Path | None = None,
    faults: Sequence[Injection] = (),
) -> None:
    """Run an emulator until SIGTERM or SIGINT; `announce` is given the `Emulator.address`."""
    devices = FAMILIES[platform.family].emulate(platform, lockstep, seed)
    with Emulator(devices, lockstep, device_link, plant_link, control) as emulator:
        for fault in faults:
            devices.faults.add(fault)
        # A handler that does nothing but set a flag, and the pipe that wakes select() up.
        numbers = (signal.SIGTERM, signal.SIGINT)
        former = {number: signal.signal(number, lambda *_: emulator.stop()) for number in numbers}
        former_fd = signal.set_wakeup_fd(emulator.wake_descriptor)
        with contextlib.suppress(OSError):  # Linux rounds waits up by 50 us otherwise, half a frame
            Path("/proc/self/timerslack_ns").write_text("1000", encoding="ascii")
        try:
            announce(emulator.address)
            emulator.run(clock)
        finally:
            signal.set_wakeup_fd(former_fd)
            for number, handler in former.items():
                signal.signal(number, handler)
