"""The process that vents when a driver dies whose devices would keep their pressure.

It owns nothing while the driver lives: it waits on a pipe. The driver writes into it what is to be done (one
line of JSON, the newest counts) and, when it ends in order, the word ``end``. If the pipe closes without that
word, the driver is dead, whatever killed it; the process then opens the ports itself, sends every device its
set point 0, and looks for the confirmation. It is a script of the standard library alone, so that it starts
quickly and nothing that breaks the driver breaks it.

It cannot help when the whole machine stops or the cable is out: the arm needs a normally open dump valve.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import select
import signal
import socket
import sys
import termios
import threading
import time
from typing import Any

OPEN_LIMIT_S = 2.0
ROUNDS = 20
_SETTLE_S = 0.02
_LONGEST_LINE = 4096

Plan = list[dict[str, Any]]


def await_end(descriptor: int) -> Plan | None:
    """Wait for the driver's end; the plan to carry out, or None after an orderly one."""
    plan: Plan | None = None
    rest = b""
    while chunk := os.read(descriptor, 65536):
        *lines, rest = (rest + chunk).split(b"\n")
        for line in lines:
            if line == b"end":
                return None
            plan = json.loads(line)
    return plan


def carry_out(plan: Plan) -> bool:
    """Vent everything of a plan, all lines at once; whether all devices have confirmed."""
    done: list[bool] = []
    threads = [threading.Thread(target=lambda e=entry: done.append(_vent_line(e))) for entry in plan]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return len(done) == len(plan) and all(done)


def _vent_line(entry: dict[str, Any]) -> bool:
    descriptor = _open(entry["address"], int(entry.get("baud", 9600)))
    if descriptor is None:
        _say(f"{entry['address']}: cannot open it to vent")
        return False
    try:
        # Ends a line that the driver has begun, and lets an answer to it pass by.
        os.write(descriptor, entry.get("begin", "\r\n").encode("latin-1"))
        _read(descriptor, _SETTLE_S, None)
        left = list(entry["steps"])
        for _ in range(ROUNDS):
            left = [step for step in left if not _send(descriptor, step, float(entry["timeout_s"]))]
            if not left:
                return True
    except OSError as error:
        _say(f"{entry['address']}: {error}")
        return False
    else:
        _say(f"{entry['address']}: not confirmed: {', '.join(repr(step['send']) for step in left)}")
        return False
    finally:
        os.close(descriptor)


def _send(descriptor: int, step: dict[str, str], timeout_s: float) -> bool:
    """Send one command; whether the answer is the one that confirms it."""
    with contextlib.suppress(BlockingIOError):
        while os.read(descriptor, 65536):
            pass
    os.write(descriptor, step["send"].encode("latin-1"))
    return "expect" not in step or _read(descriptor, timeout_s, re.compile(step["expect"]))


def _read(descriptor: int, timeout_s: float, expected: re.Pattern[str] | None) -> bool:
    """Read for a while, until a line matches."""
    rest = b""
    end_s = time.monotonic() + timeout_s
    while (left_s := end_s - time.monotonic()) > 0 and select.select([descriptor], [], [], left_s)[0]:
        with contextlib.suppress(BlockingIOError):
            chunk = os.read(descriptor, 65536)
            if not chunk:
                raise OSError("end of file")
            *lines, rest = re.split(rb"[\r\n]+", (rest + chunk)[-_LONGEST_LINE:])
            texts = [line.decode("latin-1").strip() for line in lines]
            if expected is not None and any(expected.fullmatch(text) for text in texts):
                return True
    return False


def _open(address: str, baud: int) -> int | None:
    """Open a serial port or a TCP connection (host:port); again and again while the driver's lock goes."""
    end_s = time.monotonic() + OPEN_LIMIT_S
    while True:
        with contextlib.suppress(OSError, termios.error):
            return _open_tcp(address) if _is_tcp(address) else _open_serial(address, baud)
        if time.monotonic() > end_s:
            return None
        time.sleep(0.005)


def _is_tcp(address: str) -> bool:
    return not address.startswith("/") and ":" in address


def _open_tcp(address: str) -> int:
    host, _, port = address.rpartition(":")
    with socket.create_connection((host, int(port)), timeout=OPEN_LIMIT_S) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
        return os.dup(connection.fileno())


def _open_serial(path: str, baud: int) -> int:
    descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # held by the driver while it lives
        attributes = termios.tcgetattr(descriptor)
        speed = getattr(termios, f"B{baud}")
        control = attributes[6]
        control[termios.VMIN], control[termios.VTIME] = 1, 0
        raw = termios.CS8 | termios.CREAD | termios.CLOCAL
        termios.tcsetattr(descriptor, termios.TCSANOW, [0, 0, raw, 0, speed, speed, control])
        termios.tcflush(descriptor, termios.TCIOFLUSH)  # what the driver left unsent is not to be sent now
    except (OSError, termios.error):
        os.close(descriptor)
        raise
    return descriptor


def _say(text: str) -> None:
    with contextlib.suppress(OSError):
        sys.stderr.write(f"soro supervisor: {text}\n")
        sys.stderr.flush()


def main() -> int:
    """Wait on standard input; 0 when there was nothing to do or everything has confirmed."""
    # Ends with the driver only: a Ctrl-C is for both, and the driver shuts down in order.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    os.write(sys.stdout.fileno(), b"ready\n")
    plan = await_end(sys.stdin.fileno())
    if plan is None:
        return 0
    started_s = time.monotonic()
    is_vented = carry_out(plan)
    took_ms = 1e3 * (time.monotonic() - started_s)
    outcome = "vented" if is_vented else "NOT ALL VENTED: open the dump valve"
    _say(f"the driver died; {outcome} ({took_ms:.0f} ms)")
    return 0 if is_vented else 1


if __name__ == "__main__":
    sys.exit(main())
