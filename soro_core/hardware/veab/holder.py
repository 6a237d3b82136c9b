"""The process that holds the connection to a VEAB server beside the driver, and vents when that dies.

The published server ends, and keeps its pressures, as soon as its client's connection does; a new client
finds nobody. So this process has the driver's own connection, as a second descriptor, and does nothing with
it while the driver lives. When the driver is gone without the word ``end``, it sends 0.5 (0 kPa) for every
port until readings show that the arm is empty. It is a script of the standard library alone: it starts
quickly, and what breaks the driver does not break it.

Usage: holder.py PORTS VENTED_PA, with a Unix socket as standard input; there ``take`` brings a descriptor.
"""

from __future__ import annotations

import contextlib
import select
import signal
import socket
import struct
import sys
import time

_PERIOD_S = 0.004
# The readings that are on their way may be older than the set points; and the server needs its turn to write.
_LEAST_S, _LONGEST_S = 0.05, 10.0
_PA_PER_VOLT, _ZERO_V = 20e3, 5.0


def await_end(control: socket.socket) -> socket.socket | None:
    """Wait for the driver's end; the connection to vent through, or None after an orderly end."""
    held: socket.socket | None = None
    while True:
        try:
            words, descriptors, _, _ = socket.recv_fds(control, 4096, 16)
        except OSError:
            return held
        if not words:
            return held
        for word in words.split(b"\n")[:-1]:
            if held is not None:
                held.close()
                held = None
            if word == b"end":
                return None
            if word == b"take":
                held = socket.socket(fileno=descriptors.pop(0))
                held.setblocking(False)


def vent(connection: socket.socket, ports: int, vented_pa: float) -> bool:
    """Send 0.5 for every port until a reading shows all of them empty; whether one did."""
    message, size, buffer = struct.pack(f"<{ports}d", *[0.5] * ports), 8 * ports, b""
    start_s = time.monotonic()
    while (passed_s := time.monotonic() - start_s) < _LONGEST_S:
        with contextlib.suppress(BlockingIOError):
            connection.send(message)
        select.select([connection], [], [], _PERIOD_S)
        with contextlib.suppress(BlockingIOError):
            chunk = connection.recv(65536)
            if not chunk:
                raise OSError("closed by the server")
            buffer += chunk
        while len(buffer) >= size:
            volts, buffer = struct.unpack(f"<{ports}d", buffer[:size]), buffer[size:]
            is_empty = all(abs(value - _ZERO_V) * _PA_PER_VOLT < vented_pa for value in volts)
            if is_empty and passed_s >= _LEAST_S:
                return True
    return False


def main(ports: int, vented_pa: float) -> int:
    """Wait on standard input; 0 when there was nothing to do or the arm has been seen empty."""
    # Ends with the driver only: a Ctrl-C is for both, and the driver shuts down in order.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    control = socket.socket(fileno=sys.stdin.fileno())
    control.send(b"ready\n")
    held = await_end(control)
    if held is None:
        return 0
    is_vented, why = False, "readings do not fall"
    try:
        is_vented = vent(held, ports, vented_pa)
    except OSError as error:
        why = str(error)
    outcome = "vented" if is_vented else f"NOT VENTED ({why}): open the dump valve"
    with contextlib.suppress(OSError):
        sys.stderr.write(f"soro: the driver died; {outcome}\n")
    return 0 if is_vented else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), float(sys.argv[2])))
