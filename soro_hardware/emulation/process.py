"""The emulator process: an event loop that serves the lines, the plant link and the control socket."""

from __future__ import annotations

import contextlib
import os
import selectors
from collections.abc import Callable, Sequence
from pathlib import Path

from soro_core.errors import HardwareError
from soro_core.files.private_folder import make_private
from soro_hardware.emulation.devices import EmulatedDevices
from soro_hardware.emulation.endpoints import ENDPOINTS, PtyEndpoint, TcpEndpoint
from soro_hardware.emulation.faults.fault_types import Injection
from soro_hardware.emulation.sockets.control import ControlServer
from soro_hardware.emulation.sockets.plant_server import PlantLinkServer
from soro_hardware.error_text import reason
from soro_hardware.families import find_family
from soro_hardware.platform import PlatformBase
from soro_hardware.signals import ended_by_signals


def emulate(platform: PlatformBase, lockstep: bool, seed: int) -> EmulatedDevices:
    """Make the emulated devices of a platform; parameters as in `EmulatedDevices`."""
    family = find_family(platform.family)
    devices: EmulatedDevices = family.find(family.emulator)(platform, lockstep, seed)
    return devices


class Emulator:
    """Serves emulated devices of any family to a host.

    Parameters
    ----------
    devices : EmulatedDevices
        Devices to serve.
    device_link : Path, optional
        Symbolic link to make: to the pseudo-terminal of the line, or, for TCP, with its address as target.
        For several lines it is a folder of links 0, 1, ..., in which only this user may write. An older link
        is replaced.
    plant_link : Path, optional
        Unix socket for a twin, see `soro_hardware.emulation.sockets.plant_link`.
    control : Path, optional
        Unix socket for faults, see `soro_hardware.emulation.sockets.control`.

    Raises
    ------
    HardwareError
        If a link or the socket cannot be made.
    """

    def __init__(
        self,
        devices: EmulatedDevices,
        device_link: Path | None = None,
        plant_link: Path | None = None,
        control: Path | None = None,
    ) -> None:
        self.devices = devices
        self._stopped = False
        self._clock: Callable[[], int] = lambda: 0
        self._start_ns = 0
        # select() waits with a resolution of 1 us; epoll and poll round up to 1 ms, the time of ten frames.
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
        # Takes effect at the start of the next turn, because a fault begins while the line is in use.
        self._plugged = True
        devices.faults.on_start["adapter_unplug"] = lambda _: self._set_plugged(False)
        devices.faults.on_end["adapter_unplug"] = lambda _: self._set_plugged(True)
        try:
            if control is not None:
                self._control = ControlServer(control, devices.faults, self._selector)
            if plant_link is not None:
                self._plant = PlantLinkServer(
                    plant_link, lambda: devices.pressure_pa, self._selector, devices.lockstep
                )
                devices.on_tick = self._plant.publish
                devices.connect_plant(self._plant.pressures)
            self._plug()
        except HardwareError:
            self.close()
            raise

    @property
    def address(self) -> str:
        """Path or address of each line, as the host opens it, separated by commas."""
        return ",".join(endpoint.address for endpoint in self._endpoints)

    def run(self, clock: Callable[[], int]) -> None:
        """Serve until `stop`; `clock` returns a monotonic time [ns]."""
        self._clock, self._start_ns = clock, clock()
        while not self._stopped:
            if self._plugged != bool(self._endpoints):
                (self._plug if self._plugged else self._unplug)()
            timeout = None
            if not self.devices.lockstep:
                # The emulated time does not advance while the process is stalled.
                self._start_ns += self.devices.run(self._now_ns())
                timeout = max((self.devices.next_event_ns - self._now_ns()) * 1e-9, 0.0)
            self._write()
            for key, _ in self._selector.select(timeout):
                key.data()

    @property
    def wake_descriptor(self) -> int:
        """Descriptor to which a byte wakes `run`, as the interpreter writes it for a signal."""
        return self._wake[1]

    def wake(self) -> None:
        """Make `run` call `on_wake` and check for `stop`; from any thread."""
        os.write(self._wake[1], b".")

    def stop(self) -> None:
        """End `run` after the present turn; may be called from a signal handler."""
        self._stopped = True

    def close(self) -> None:
        """Close lines and sockets and remove the links."""
        self._unplug()
        for server in (self._plant, self._control):
            if server is not None:
                server.close()
        self._selector.close()
        for descriptor in self._wake:
            os.close(descriptor)

    def __enter__(self) -> Emulator:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _woken(self) -> None:
        os.read(self._wake[0], 64)
        self.on_wake()

    def _now_ns(self) -> int:
        return self._clock() - self._start_ns

    def _before_input(self) -> None:
        if not self.devices.lockstep:
            self.devices.run(self._now_ns())  # the devices receive bytes at the time of their arrival

    def _write(self) -> None:
        for endpoint in self._endpoints:
            endpoint.write()
            # In lockstep no byte may be lost: wait for the host.
            while self.devices.lockstep and endpoint.line.output and not self._stopped:
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
        """Close the endpoints and remove the links."""
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
                if name.is_symlink():  # of an emulator with one line that was killed
                    name.unlink()
                make_private(name)
                links = [name / str(number) for number in range(len(self._endpoints))]
            for link, endpoint in zip(links, self._endpoints, strict=True):
                if link.is_symlink():
                    link.unlink()
                link.symlink_to(endpoint.address)
                self._links[link] = endpoint.address
        except OSError as error:
            raise HardwareError(f"cannot link to the emulated line ({reason(error)})", name, "open") from None


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
    """Run an emulator until SIGTERM or SIGINT.

    Parameters
    ----------
    platform : PlatformBase
        Platform to emulate.
    clock : callable
        Returns a monotonic time [ns].
    announce : callable
        Called once, with `Emulator.address`, when the lines are open.
    lockstep : bool
        Whether the host's cycles advance the time.
    device_link, plant_link, control : Path, optional
        Paths as in `Emulator`.
    seed : int
        Seed of the sensor noise and of random faults.
    faults : sequence of Injection
        Faults to schedule from the start.

    Raises
    ------
    HardwareError
        If a link or a socket cannot be made.
    ConfigError
        If the devices do not support a fault.
    """
    devices = emulate(platform, lockstep, seed)
    with Emulator(devices, device_link, plant_link, control) as emulator:
        for fault in faults:
            devices.faults.add(fault)
        with ended_by_signals(emulator.stop, emulator.wake_descriptor):
            announce(emulator.address)
            emulator.run(clock)
