"""The emulator as a process: a pseudo-terminal as adapter, a socket as plant link, one loop around both."""

from __future__ import annotations

import contextlib
import os
import pty
import selectors
import signal
import tty
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from soro_core.errors import HardwareError
from soro_core.hardware.emulation.slcan_server import SlcanServer
from soro_core.hardware.emulation.world import World
from soro_core.hardware.plant_link import PlantLinkServer
from soro_core.hardware.platform import Platform


class Emulator:
    """Emulated devices of a platform, served on a pseudo-terminal.

    Parameters
    ----------
    platform : Platform
        What is emulated.
    lockstep : bool
        Whether SYNC is the clock, or the time given to `run`.
    device_link : Path, optional
        Symbolic link to make to the pseudo-terminal; an older link at that path is replaced.
    plant_link : Path, optional
        Unix socket on which the true pressures are published.
    seed : int
        Seed of the sensor noise.

    Raises
    ------
    HardwareError
        If the link or the socket cannot be made.
    """

    def __init__(
        self,
        platform: Platform,
        lockstep: bool,
        device_link: Path | None = None,
        plant_link: Path | None = None,
        seed: int = 0,
    ) -> None:
        self._lockstep = lockstep
        self._stopped = False
        self._master, self._slave = pty.openpty()
        # The slave stays open here, so that the line outlives a host, as an adapter does.
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.pty_path = os.ttyname(self._slave)
        self._link = device_link
        self._server = SlcanServer(lambda frame: self.world.host_sends(frame))
        self.world = World(platform, self._server.deliver, lockstep, seed)
        self._plant: PlantLinkServer | None = None
        # select() waits with microseconds; epoll and poll round up to milliseconds, longer than ten frames.
        self._selector = selectors.SelectSelector()
        self._selector.register(self._master, selectors.EVENT_READ)
        try:
            if plant_link is not None:
                self._plant = PlantLinkServer(plant_link)
                self._selector.register(self._plant, selectors.EVENT_READ)
                self.world.on_tick = self._plant.publish
            if device_link is not None:
                _symlink(self.pty_path, device_link)
        except HardwareError:
            self._link = None
            self.close()
            raise

    def run(self, clock: Callable[[], int]) -> None:
        """Serve until `stop`; `clock` gives a monotonic time [ns]."""
        start_ns = clock()
        while not self._stopped:
            timeout = None
            if not self._lockstep:
                # What the process was held up stays a hole in the world's time.
                start_ns += self.world.run(clock() - start_ns)
                timeout = max((self.world.next_event_ns - (clock() - start_ns)) * 1e-9, 0.0)
            self._write()
            for key, _ in self._selector.select(timeout):
                if key.fd == self._master:
                    self._read(None if self._lockstep else clock() - start_ns)
                elif self._plant is not None and key.fileobj is self._plant:
                    self._plant.accept()

    def wake_on(self, descriptor: int) -> None:
        """Let `run` look whether it has been stopped when a descriptor becomes readable."""
        self._selector.register(descriptor, selectors.EVENT_READ)

    def stop(self) -> None:
        """End `run` after the present turn; may be called from a signal handler."""
        self._stopped = True

    def close(self) -> None:
        """Take away what the constructor made."""
        if self._link is not None and self._link.is_symlink() and os.readlink(self._link) == self.pty_path:
            self._link.unlink()
        if self._plant is not None:
            self._plant.close()
        self._selector.close()
        for descriptor in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    def __enter__(self) -> Emulator:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _read(self, now_ns: int | None) -> None:
        with contextlib.suppress(BlockingIOError):
            chunk = os.read(self._master, 65536)
            if now_ns is not None:
                self.world.run(now_ns)  # frames are queued at the time at which they came
            self._server.feed(chunk)

    def _write(self) -> None:
        output = self._server.output
        if output:
            with contextlib.suppress(BlockingIOError):
                del output[: os.write(self._master, output)]
            if output and not self._lockstep:
                return
            while output and not self._stopped:  # in lockstep nothing may be lost: wait for the host
                self._wait_writable()

    def _wait_writable(self) -> None:
        with selectors.SelectSelector() as selector:
            selector.register(self._master, selectors.EVENT_WRITE)
            if selector.select(0.1):
                with contextlib.suppress(BlockingIOError):
                    del self._server.output[: os.write(self._master, self._server.output)]


def serve(
    platform: Platform,
    clock: Callable[[], int],
    announce: Callable[[str], None],
    lockstep: bool = False,
    device_link: Path | None = None,
    plant_link: Path | None = None,
    seed: int = 0,
) -> None:
    """Run an emulator until SIGTERM or SIGINT; `announce` is given the pseudo-terminal's path."""
    with Emulator(platform, lockstep, device_link, plant_link, seed) as emulator:
        # A handler that does nothing but set a flag, and a pipe that wakes select() up.
        wake_read, wake_write = os.pipe()
        os.set_blocking(wake_write, False)
        emulator.wake_on(wake_read)
        numbers = (signal.SIGTERM, signal.SIGINT)
        former = {number: signal.signal(number, lambda *_: emulator.stop()) for number in numbers}
        former_fd = signal.set_wakeup_fd(wake_write)
        with contextlib.suppress(OSError):  # Linux rounds waits up by 50 us otherwise, half a frame
            Path("/proc/self/timerslack_ns").write_text("1000", encoding="ascii")
        try:
            announce(emulator.pty_path)
            emulator.run(clock)
        finally:
            signal.set_wakeup_fd(former_fd)
            for number, handler in former.items():
                signal.signal(number, handler)
            os.close(wake_read)
            os.close(wake_write)


def _symlink(target: str, link: Path) -> None:
    try:
        if link.is_symlink():
            link.unlink()
        link.symlink_to(target)
    except OSError as error:
        raise HardwareError(f"{link}: cannot link to the emulated adapter ({error})") from None
