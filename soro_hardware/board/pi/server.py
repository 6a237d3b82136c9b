"""`soro board`: serves the ports of a platform over TCP; also ``python -m soro_hardware.board.pi.server``.

The module needs neither ROS nor numba, so that a Raspberry Pi can run it.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from soro_core.errors import ConfigError, HardwareError, SoroError
from soro_core.extras import named_packages
from soro_hardware.board.chips import I2cBus
from soro_hardware.board.config import BoardPlatform, StopContact
from soro_hardware.board.pi.board import Board, describe
from soro_hardware.board.pi.contact import ContactLine, GpioLine, StopInput
from soro_hardware.board.pi.loop import Server
from soro_hardware.board.pi.ports import Ports
from soro_hardware.board.pi.watcher import watched
from soro_hardware.families import load_platform
from soro_hardware.signals import ended_by_signals

# From linux/i2c-dev.h. By default the kernel waits one second for a blocked bus, too long for the others.
_I2C_RETRIES, _I2C_TIMEOUT = 0x0701, 0x0702
_TIMEOUT_10MS = 1


class LinuxI2c:
    """The bus ``/dev/i2c-<number>``.

    Raises
    ------
    MissingPackageError
        If smbus2 is not installed.
    HardwareError
        If the bus cannot be opened.
    """

    def __init__(self, number: int) -> None:
        with named_packages():
            import smbus2
        try:
            self._bus: Any = smbus2.SMBus(number)
            fcntl.ioctl(self._bus.fd, _I2C_TIMEOUT, _TIMEOUT_10MS)
            fcntl.ioctl(self._bus.fd, _I2C_RETRIES, 0)
        except OSError as error:
            text = f"cannot open ({error.strerror}); is it enabled, and are you in group i2c?"
            raise HardwareError(text, f"/dev/i2c-{number}", "open") from None
        self._message = smbus2.i2c_msg

    def write(self, address: int, data: bytes) -> None:
        self._bus.i2c_rdwr(self._message.write(address, data))

    def read(self, address: int, length: int) -> bytes:
        message = self._message.read(address, length)
        self._bus.i2c_rdwr(message)
        return bytes(message)

    def close(self) -> None:
        self._bus.close()


def serve(
    platform: BoardPlatform,
    open_bus: Callable[[int], I2cBus],
    address: tuple[str, int],
    announce: Callable[[str], None],
    beat: Callable[[], None] = lambda: None,
    open_contact: Callable[[StopContact], ContactLine] = GpioLine,
) -> None:
    """Test the ports and serve them until SIGTERM or SIGINT.

    Parameters
    ----------
    platform : BoardPlatform
        Ports and times.
    open_bus : callable
        Opens an I2C bus by its number.
    address : tuple
        Interface ("" for all) and TCP port (0 for a free one) to listen on.
    announce : callable
        Called with each line of output: the self-tests, then ``ready: host:port``.
    beat : callable
        Called in every turn of the loop.
    open_contact : callable
        Opens the line of the emergency stop's contact.

    Raises
    ------
    HardwareError
        If a bus or the TCP port cannot be opened.
    """
    buses = {port.bus for port in platform.ports}
    with contextlib.ExitStack() as stack:
        # Transfers release the interpreter lock, so that the buses work in parallel.
        executor = stack.enter_context(ThreadPoolExecutor(len(buses))) if len(buses) > 1 else None
        ports = Ports(platform, open_bus, time.sleep, executor)
        stack.callback(ports.close)
        stop = _stop_of(platform, open_contact, stack)
        boot = int.from_bytes(os.urandom(4), "little")
        board = Board(platform, ports, boot, lambda reports: _say(announce, describe(reports)), stop)
        board.start(time.monotonic_ns())
        try:
            listener = stack.enter_context(socket.create_server(address))
        except OSError as error:
            raise HardwareError(
                f"cannot listen ({error.strerror})", f"{address[0]}:{address[1]}", "open"
            ) from None
        server = Server(board, listener, time.monotonic_ns, beat)
        stack.enter_context(_stopped_by_signals(server))
        announce("ready: {}:{}".format(*listener.getsockname()[:2]))
        server.run()


def run_board(
    config: str,
    listen: str,
    announce: Callable[[str], None],
    check: bool = False,
    store_safe: bool = False,
    open_bus: Callable[[int], I2cBus] = LinuxI2c,
    open_contact: Callable[[StopContact], ContactLine] = GpioLine,
) -> int:
    """Run the command `soro board`.

    Parameters
    ----------
    config : str
        Name or path of the platform file.
    listen : str
        ``HOST`` or ``HOST:PORT``; empty for every interface and the platform's port.
    announce : callable
        Called with each line of output.
    check, store_safe : bool
        Make the self-test and end; store 0 Pa as power-on value first.
    open_bus : callable
        Opens an I2C bus by its number.
    open_contact : callable
        Opens the line of the emergency stop's contact.

    Returns
    -------
    int
        Exit status: 1 if a port fails the self-test of `check`.

    Raises
    ------
    SoroError
        If the platform file is wrong or the hardware is missing.
    """
    platform = load_platform(config)
    if not isinstance(platform, BoardPlatform):
        raise ConfigError(config, "family", platform.family, "soro_board")
    if check or store_safe:
        return _test(platform, open_bus, open_contact, announce, store_safe)

    host, _, port = listen.rpartition(":") if ":" in listen else (listen, "", "")
    if not f"{port or 0}".isdecimal():
        raise ConfigError("soro board", "--listen", listen, "HOST or HOST:PORT")
    address = (host, int(port or platform.transport.port))

    watchers_own = Ports(platform, open_bus, time.sleep)

    def run(beat: Callable[[], None]) -> int:
        serve(platform, open_bus, address, announce, beat, open_contact)
        return 0

    return watched(run, watchers_own.vent, platform.board.hang_s)


def _test(
    platform: BoardPlatform,
    open_bus: Callable[[int], I2cBus],
    open_contact: Callable[[StopContact], ContactLine],
    announce: Callable[[str], None],
    store_safe: bool,
) -> int:
    ports = Ports(platform, open_bus, time.sleep)
    if store_safe:
        ports.store_safe()
    reports = ports.self_test()
    _say(announce, describe(reports))
    with contextlib.ExitStack() as stack:
        if (stop := _stop_of(platform, open_contact, stack)) is not None:
            is_pressed = stop.is_pressed(time.monotonic_ns())
            announce(f"stop contact: {'OPEN: pressed, or a broken wire' if is_pressed else 'closed'}")
    return int(any(report.error for report in reports))


def _stop_of(
    platform: BoardPlatform,
    open_contact: Callable[[StopContact], ContactLine],
    stack: contextlib.ExitStack,
) -> StopInput | None:
    """Open the contact of the emergency stop, if there is one; the end of the stack closes it."""
    contact = platform.board.stop
    if contact is None:
        return None
    line = open_contact(contact)
    stack.callback(line.close)
    return StopInput(contact, line)


def _say(announce: Callable[[str], None], lines: list[str]) -> None:
    for line in lines:
        announce(line)


@contextlib.contextmanager
def _stopped_by_signals(server: Server) -> Iterator[None]:
    """Stop the server at a signal; a pipe ends the wait in select()."""
    wake_read, wake_write = os.pipe()
    os.set_blocking(wake_write, False)
    server.wake_on(wake_read)
    try:
        with ended_by_signals(server.stop, wake_write):
            yield
    finally:
        os.close(wake_read)
        os.close(wake_write)


def main(arguments: list[str] | None = None) -> int:
    """Parse the command line and serve; return 0 after a signal, 2 for wrong use, 1 for another error."""
    parser = argparse.ArgumentParser(prog="python -m soro_hardware.board.pi.server", description=__doc__)
    parser.add_argument("config", help="name of a shipped platform, or path of a platform file")
    parser.add_argument("--listen", default="", help="HOST or HOST:PORT to listen on; all and the platform's")
    parser.add_argument("--check", action="store_true", help="test every chip, report, and end")
    parser.add_argument(
        "--store-safe", action="store_true", help="make 0 Pa the power-up value of every DAC, test, and end"
    )
    given = parser.parse_args(arguments)
    try:
        return run_board(given.config, given.listen, _print, given.check, given.store_safe)
    except SoroError as error:
        sys.stderr.write(f"soro: {error}\n")
        return 2 if isinstance(error, ConfigError) else 1


def _print(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
