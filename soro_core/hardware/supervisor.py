"""The process that vents when a driver dies whose devices would keep their pressure.

While the driver lives it only waits, and has the driver's own ports and connections as second descriptors: so
a lock stays held, a server that ends with its client does not end, and nothing has to be opened in need. When
the driver goes without the word ``end``, whatever killed it, this process sends what it was told to, again
and again until the devices confirm it. It is a script of the standard library alone: it starts quickly, and
what breaks the driver does not break it.

It cannot help when the whole machine stops or the cable is out: the arm needs a normally open dump valve.

It does the same when the driver is silent with pressure in the arm: stopped, or in a call that does not
return. Then it ends, so that a driver that comes back finds it gone, and vents.

Standard input is a Unix socket. A message there is ``end``, ``left`` (the driver ends in order, and has not
seen the arm empty), ``+`` (the driver is at work and has asked for
pressure: silence after it is an end), ``-`` (it has not), or a plan, which takes the place of the one before
and of ``+``: a JSON list with one entry a line, with the descriptors in the same order. An entry has

- ``name``: the line, for texts;
- ``begin``: bytes (as Latin-1) that end what the driver has begun, or nothing;
- ``steps``: what to ``send`` (the same) and the answer that confirms it: a regular expression for a ``line``
  of text, the ``bytes`` themselves, or so many consecutive ``doubles`` between ``low`` and ``high``;
- ``timeout_s``: for one answer; ``least_s``: time before which no answer counts; ``longest_s``: for all.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import signal
import socket
import struct
import sys
import termios
import threading
import time
from typing import Any

_MESSAGE, _LINES = 1 << 20, 64
_SETTLE_S = 0.02
SILENCE_S = 0.3  # of a driver that has asked for pressure
_MOST_CHUNKS, _LONGEST_ANSWER = 8, 4096

Entry = dict[str, Any]
Held = list[tuple[Entry, int]]


def await_end(control: socket.socket) -> tuple[Held, str]:
    """Wait for the driver's end or silence; the plan to carry out, none after an orderly end, and why."""
    held: Held = []
    control.send(b"ready")
    while True:
        try:
            message, descriptors, _, _ = socket.recv_fds(control, _MESSAGE, _LINES)
        except TimeoutError:
            return held, f"no set points for {SILENCE_S:g} s"
        except OSError:
            message = b""
        if not message:
            return held, "the driver died"
        if message == b"left":
            return held, "the driver ended and has not seen the arm empty"
        control.settimeout(SILENCE_S if message == b"+" else None)
        if message in (b"+", b"-"):
            continue
        for _, descriptor in held:
            os.close(descriptor)
        if message == b"end":
            return [], ""
        held = list(zip(json.loads(message), descriptors, strict=True))


def carry_out(held: Held) -> bool:
    """Vent every line, all at once; whether all devices have confirmed."""
    done: list[bool] = []
    threads = [threading.Thread(target=lambda of=line: done.append(_vent_line(*of))) for line in held]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return len(done) == len(held) and all(done)


def _vent_line(entry: Entry, descriptor: int) -> bool:
    """Send what is not confirmed yet, again and again."""
    started_s, left = time.monotonic(), list(entry["steps"])
    try:
        os.set_blocking(descriptor, False)
        if entry["begin"]:
            with contextlib.suppress(termios.error):  # what the driver left unsent is not to be sent now
                termios.tcflush(descriptor, termios.TCIOFLUSH)
            with contextlib.suppress(BlockingIOError):
                os.write(descriptor, entry["begin"].encode("latin-1"))
            time.sleep(_SETTLE_S)  # an answer to it is not one to what follows
        while left and (passed_s := time.monotonic() - started_s) < entry["longest_s"]:
            found = [_ask(descriptor, step, entry["timeout_s"]) for step in left]
            if passed_s >= entry["least_s"]:
                left = [step for step, is_confirmed in zip(left, found, strict=True) if not is_confirmed]
    except OSError as error:
        _say(f"{entry['name']}: {error.strerror or error}")
        return False
    if left:
        _say(f"{entry['name']}: not confirmed: {', '.join(repr(step['send']) for step in left)}")
    return not left


def _ask(descriptor: int, step: dict[str, Any], timeout_s: float) -> bool:
    """Send once; whether the answer is the one that confirms it."""
    _heard(descriptor)
    with contextlib.suppress(BlockingIOError):
        os.write(descriptor, step["send"].encode("latin-1"))
    heard, end_s = b"", time.monotonic() + timeout_s
    while (left_s := end_s - time.monotonic()) > 0 and select.select([descriptor], [], [], left_s)[0]:
        heard = (heard + _heard(descriptor))[-_LONGEST_ANSWER:]
        if _confirms(step, heard):
            return True
    return False


def _heard(descriptor: int) -> bytes:
    """Everything that has come, or much of what never ends."""
    heard = b""
    with contextlib.suppress(BlockingIOError):
        for _ in range(_MOST_CHUNKS):
            chunk = os.read(descriptor, 65536)
            if not chunk:
                raise OSError("closed by the other side")
            heard += chunk
    return heard


def _confirms(step: dict[str, Any], heard: bytes) -> bool:
    if "line" in step:
        lines = re.split(r"[\r\n]+", heard.decode("latin-1"))[:-1]
        return any(re.fullmatch(step["line"], line.strip()) for line in lines)
    if "bytes" in step:
        return step["bytes"].encode("latin-1") in heard
    # The driver may have read a part of a message, so the numbers may begin at any byte.
    count = step["doubles"]
    starts = range(max(len(heard) - 8 * count + 1, 0))
    return any(
        all(step["low"] < value < step["high"] for value in struct.unpack_from(f"<{count}d", heard, start))
        for start in starts
    )


def _say(text: str) -> None:
    with contextlib.suppress(OSError):
        sys.stderr.write(f"soro supervisor: {text}\n")
        sys.stderr.flush()


def main() -> int:
    """Wait on standard input; 0 when there was nothing to do or everything has confirmed."""
    # Ends with the driver only: a Ctrl-C is for both, and the driver shuts down in order.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    held, why = await_end(socket.socket(fileno=sys.stdin.fileno()))
    if not held:
        return 0
    started_s = time.monotonic()
    is_vented = carry_out(held)
    took_ms = 1e3 * (time.monotonic() - started_s)
    outcome = "vented" if is_vented else "NOT ALL VENTED: open the dump valve"
    _say(f"{why}; {outcome} ({took_ms:.0f} ms)")
    return 0 if is_vented else 1


if __name__ == "__main__":
    sys.exit(main())
