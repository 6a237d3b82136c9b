"""The supervisor: a process that vents devices without a watchdog when their driver dies.

The process waits while the driver works. It has duplicates of the descriptors of the driver's ports and
connections: so a lock stays, a server that ends with its client continues, and the process opens nothing in
an emergency. When the driver ends without the message ``end``, the process sends the last plan repeatedly,
until the devices confirm it. The script uses the standard library only: it starts quickly, and an error in
the driver's packages does not affect it.

The process also vents when a driver that has commanded pressure hangs. Then it ends; a driver that continues
detects this, and vents. While it waits, the process writes the time into a file in memory, so that the driver
detects a process that stands still.

It cannot vent when the machine stops or a cable is unplugged: the arm needs a normally open dump valve.

Standard input is a Unix socket; the argument is the descriptor of the file. A message is ``end``; ``left``
(the driver ends, but readings have not shown the arm empty); ``+`` (the driver works and commands pressure;
the next message must follow in time); ``-`` (the driver works and commands no pressure); ``?`` (as ``+``, but
the driver only tests whether the process vents, so success is not reported); or a plan, which replaces the
last plan and cancels ``+``. A plan is a JSON list with one entry for each line; the descriptors have the same
order. An entry has

- ``name``: name of the line, for messages;
- ``begin``: bytes (as Latin-1) that end an incomplete request of the driver, or nothing;
- ``steps``: bytes to ``send`` (as Latin-1), and the answer that confirms them: a regular expression for the
  only ``line`` of text since the step before, whose groups are numbers between ``low`` and ``high``, because
  a line does not name its request, and may be a late answer to another; a regular expression for ``bytes``
  (as Latin-1); or a number of consecutive ``doubles`` between ``low`` and ``high``. The steps of one device,
  named in ``of``, are confirmed only together in one round: a set point of 0, and the reading that shows the
  chamber empty;
- ``timeout_s``: longest wait for one answer; ``least_s``: time before which answers do not count;
  ``longest_s``: longest time for all steps.
"""

from __future__ import annotations

import contextlib
import json
import math
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
SILENCE_S = 0.3  # longest time between two signs of life: of a driver that commands pressure, of this process
_BEAT_S = 0.02
SIGN = struct.Struct("d")  # time of `time.monotonic` [s], the same clock in both processes
LEFT = "the driver ended and has not seen the arm empty"
_TESTED = "the test at the start"
_MOST_CHUNKS, _LONGEST_ANSWER = 8, 4096

Entry = dict[str, Any]
Held = list[tuple[Entry, int]]


def await_end(control: socket.socket, sign: int) -> tuple[Held, str]:
    """Wait until the driver ends or hangs; return the plan, empty after an orderly end, and the reason."""
    held: Held = []
    limit_s, silent = math.inf, f"no set points for {SILENCE_S:g} s"
    os.pwrite(sign, SIGN.pack(time.monotonic()), 0)
    control.send(b"ready")
    while True:
        now_s = time.monotonic()
        os.pwrite(sign, SIGN.pack(now_s), 0)
        # A message that has come counts, also if this process itself was late.
        if not select.select([control], [], [], max(min(_BEAT_S, limit_s - now_s), 0.0))[0]:
            if time.monotonic() >= limit_s:
                return held, silent
            continue
        try:
            message, descriptors, _, _ = socket.recv_fds(control, _MESSAGE, _LINES)
        except OSError:
            message = b""
        if not message:
            return held, "the driver died"
        if message == b"left":
            return held, LEFT
        limit_s = time.monotonic() + SILENCE_S if message in (b"+", b"?") else math.inf
        if message in (b"+", b"-"):
            continue
        if message == b"?":
            silent = _TESTED
            continue
        for _, descriptor in held:
            os.close(descriptor)
        if message == b"end":
            return [], ""
        held = list(zip(json.loads(message), descriptors, strict=True))


def carry_out(held: Held) -> bool:
    """Vent all lines at once; whether all devices have confirmed, which without a line none has."""
    done: list[bool] = []
    threads = [threading.Thread(target=lambda of=line: done.append(vent_line(*of))) for line in held]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return bool(held) and len(done) == len(held) and all(done)


def vent_line(entry: Entry, descriptor: int) -> bool:
    """Send the unconfirmed steps of a line repeatedly; return whether all are confirmed."""
    started_s, left = time.monotonic(), list(entry["steps"])
    try:
        os.set_blocking(descriptor, False)
        if entry["begin"]:
            with contextlib.suppress(termios.error):  # discard what the driver has not sent
                termios.tcflush(descriptor, termios.TCIOFLUSH)
            with contextlib.suppress(BlockingIOError):
                os.write(descriptor, entry["begin"].encode("latin-1"))
            time.sleep(_SETTLE_S)  # an answer to it must not count as the answer to a step
            _read(descriptor)
        while left and (passed_s := time.monotonic() - started_s) < entry["longest_s"]:
            found = [_ask(descriptor, step, entry["timeout_s"]) for step in left]
            if passed_s >= entry["least_s"]:
                missing = {_device(step) for step, confirms in zip(left, found, strict=True) if not confirms}
                left = [step for step in left if _device(step) in missing]
    except OSError as error:
        _say(f"{entry['name']}: {error.strerror or error}")
        return False
    if left:
        _say(f"{entry['name']}: not confirmed: {', '.join(repr(step['send']) for step in left)}")
    return not left


def _device(step: dict[str, Any]) -> str:
    device: str = step.get("of", step["send"])
    return device


def _ask(descriptor: int, step: dict[str, Any], timeout_s: float) -> bool:
    """Send a step once; return whether the answer confirms it."""
    late = _read(descriptor).strip()  # the second byte of the end of a line is none
    with contextlib.suppress(BlockingIOError):
        os.write(descriptor, step["send"].encode("latin-1"))
    answer, end_s = b"", time.monotonic() + timeout_s
    while (left_s := end_s - time.monotonic()) > 0 and select.select([descriptor], [], [], left_s)[0]:
        answer = (answer + _read(descriptor))[-_LONGEST_ANSWER:]
        if confirms(step, answer):
            return "line" not in step or not late
    return False


def _read(descriptor: int) -> bytes:
    """Return the received bytes, at most some chunks of a stream without end."""
    answer = b""
    with contextlib.suppress(BlockingIOError):
        for _ in range(_MOST_CHUNKS):
            chunk = os.read(descriptor, 65536)
            if not chunk:
                raise OSError("closed by the other side")
            answer += chunk
    return answer


def confirms(step: dict[str, Any], answer: bytes) -> bool:
    if "line" in step:
        lines = [line for line in re.split(r"[\r\n]+", answer.decode("latin-1"))[:-1] if line.strip()]
        found = re.fullmatch(step["line"], lines[0].strip()) if len(lines) == 1 else None
        return found is not None and all(step["low"] < float(n) < step["high"] for n in found.groups())
    if "bytes" in step:
        return re.search(step["bytes"].encode("latin-1"), answer, re.DOTALL) is not None
    # The driver may have read a part of a message, so the numbers may start at any byte.
    count = step["doubles"]
    starts = range(max(len(answer) - 8 * count + 1, 0))
    return any(
        all(step["low"] < value < step["high"] for value in struct.unpack_from(f"<{count}d", answer, start))
        for start in starts
    )


def _say(text: str) -> None:
    with contextlib.suppress(OSError):
        sys.stderr.write(f"soro supervisor: {text}\n")
        sys.stderr.flush()


def main() -> int:
    """Wait on standard input; return 0 if there was nothing to vent or all steps are confirmed, else 1."""
    # A Ctrl-C reaches both processes: the driver shuts down in order, this one ends after it.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    held, why = await_end(socket.socket(fileno=sys.stdin.fileno()), int(sys.argv[1]))
    if not held and why != LEFT:
        return 0
    started_s = time.monotonic()
    is_vented = carry_out(held)
    took_ms = 1e3 * (time.monotonic() - started_s)
    outcome = "vented" if is_vented else "NOT ALL VENTED: open the dump valve"
    if not (is_vented and why == _TESTED):
        _say(f"{why}; {outcome} ({took_ms:.0f} ms)")
    return 0 if is_vented else 1


if __name__ == "__main__":
    sys.exit(main())
