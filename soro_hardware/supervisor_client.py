"""The driver's end of the supervisor process (`soro_hardware.supervisor`)."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import select
import socket
import subprocess
import sys
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from soro_core.errors import HardwareError
from soro_hardware.error_text import reason
from soro_hardware.supervisor import SIGN, SILENCE_S

SCRIPT = Path(__file__).with_name("supervisor.py")
START_LIMIT_S = 10.0
_END_LIMIT_S, _POLL_S, _TEST_POLL_S = 2.0, 0.002, 0.02
_WHO = "the process that vents when the driver dies"


@dataclass(frozen=True)
class VentPlan:
    """Messages that vent the devices of one line, with the answers that confirm it; see `supervisor`."""

    name: str
    steps: tuple[dict[str, Any], ...]
    timeout_s: float
    longest_s: float
    least_s: float = 0.0
    begin: str = ""


class TakenOverError(Exception):
    """The supervisor may have vented, so no set point may follow."""


class Supervisor:
    """The supervisor: a process that vents when the driver's process dies or hangs.

    No call waits for the process, except `wait_until_ready`, and `dismiss` for its end.

    Attributes
    ----------
    lost : str
        Why the process no longer protects the arm; empty while it does.

    Raises
    ------
    HardwareError
        If it cannot be started.
    """

    def __init__(self) -> None:
        self.control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.control.setblocking(False)
        # The process writes its signs of life into this file. Messages would fill a queue, and the newest
        # ones would be lost, while the driver does not read; the last number in a file is always the newest.
        self._sign = os.memfd_create("soro supervisor")
        weakref.finalize(self, os.close, self._sign)
        self.lost = ""
        self._is_ready = self._pressed = self._stands_still = False
        self._told_s = self._since_s = time.monotonic()
        try:
            # Isolated, and in its own session: signals to the driver's group do not reach it.
            self.process: subprocess.Popen[bytes] = subprocess.Popen(
                [sys.executable, "-I", "-S", str(SCRIPT), str(self._sign)],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                pass_fds=(self._sign,),
                start_new_session=True,
                cwd="/",
            )
        except OSError as error:
            self.control.close()
            raise HardwareError(f"cannot start ({reason(error)})", "supervisor", "open") from None
        finally:
            theirs.close()

    @property
    def is_alive(self) -> bool:
        """Whether the process waits for the driver's end; one that already vents does not."""
        if self.process.poll() is not None:
            self._lose(f"{_WHO} has ended")
        return not self.lost

    def watches(self, pressed: bool) -> bool:
        """Report that the driver works, and whether it commands pressure; return `is_alive`.

        While pressure is commanded, the process vents 0.3 s after the last call. So a driver that calls later
        must not command pressure any more: the process counts as lost. It is also lost if it has given no
        sign of life for 0.3 s. That time does not count a pause of the driver without pressure, because a
        machine that stalls stops both.
        """
        now_s = time.monotonic()
        pause_s, self._told_s = now_s - self._told_s, now_s
        if pause_s > SILENCE_S:
            self._since_s = now_s
            if self._pressed:
                self._lose(f"the driver stood still for {pause_s:.2f} s, so {_WHO} may have vented")
        was_pressed, self._pressed = self._pressed, pressed
        if (silent_s := now_s - self._heard_s) > SILENCE_S:
            self._stands_still = True
            self._lose(f"{_WHO} has stood still for {silent_s:.2f} s")
        if (pressed or was_pressed) and not self.lost:
            self._say(b"+" if pressed else b"-")
        return self.is_alive

    def test(self, longest_s: float, wait: Callable[[float], None]) -> None:
        """Fall silent as a driver that hangs, and require that the process vents; it then has ended.

        Parameters
        ----------
        longest_s : float
            Longest time [s] for the vent, after the silence.
        wait : callable
            Waits for a time [s].

        Raises
        ------
        HardwareError
            If the process does not take over in time, or the devices do not confirm the vent.
        """
        self._send(b"?")
        end_s = time.monotonic() + SILENCE_S + longest_s
        while self.process.poll() is None and time.monotonic() < end_s:
            wait(_TEST_POLL_S)
        self._lose(f"{_WHO} has ended")
        if status := self.process.poll():
            text = "the devices did not confirm its vent, see its line above"
        else:
            text = f"it has not vented {SILENCE_S + longest_s:g} s after the last message"
        if status != 0:
            raise HardwareError(f"test at 0 Pa: {text}", "supervisor", "refused", "start-up")

    @property
    def pid(self) -> int:
        """Process id."""
        return self.process.pid

    def wait_until_ready(self) -> None:
        """Wait until the process is ready.

        Raises
        ------
        HardwareError
            If it ends at its start, or is not ready in time.
        """
        if self._is_ready:
            return
        if not select.select([self.control], [], [], START_LIMIT_S)[0]:
            raise HardwareError(f"not ready within {START_LIMIT_S:g} s", "supervisor", "silent")
        with contextlib.suppress(OSError):  # of a process that has ended
            self._is_ready = bool(self.control.recv(16))
        if not self._is_ready:
            raise HardwareError("its process ended at the start", "supervisor", "gone")
        self._told_s = self._since_s = time.monotonic()

    def hold(self, plan: Sequence[VentPlan], descriptors: Sequence[int]) -> None:
        """Pass a plan and the descriptor of each line to the process, in place of the last plan.

        If the process has ended or stands still, the call does not raise; `is_alive` is then false.

        Raises
        ------
        HardwareError
            If the process runs and the descriptors cannot be passed.
        """
        self.wait_until_ready()
        message = json.dumps([asdict(line) for line in plan]).encode()
        try:
            self._send(message, descriptors)
        except OSError as error:
            raise HardwareError(f"cannot receive the ports ({reason(error)})", "supervisor", "open") from None

    def release(self) -> None:
        """Make the process close its descriptors."""
        self._say(b"[]")

    def dismiss(self, vented: bool = True) -> None:
        """End the process at once, or, if the arm is not `vented`, after it has vented it."""
        self._say(b"end" if vented else b"left")
        self.control.close()
        end_s = time.monotonic() + (0.0 if self._stands_still else _END_LIMIT_S)
        while self.process.poll() is None and time.monotonic() < end_s:
            time.sleep(_POLL_S)
        if vented and self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self._lose(f"{_WHO} has ended")

    @property
    def _heard_s(self) -> float:
        """Time from which silence of the process counts: its last sign of life, or the driver's pause."""
        sign = os.pread(self._sign, SIGN.size, 0)
        return max(SIGN.unpack(sign)[0], self._since_s) if sign else self._since_s

    def _lose(self, why: str) -> None:
        self.lost = self.lost or why

    def _say(self, message: bytes) -> None:
        try:
            self._send(message)
        except OSError as error:
            self._lose(f"{_WHO} cannot be reached ({reason(error)})")

    def _send(self, message: bytes, descriptors: Sequence[int] = ()) -> None:
        """Send a message without waiting; a process that does not take it is lost."""
        try:
            socket.send_fds(self.control, [message], descriptors)
        except BlockingIOError:
            self._stands_still = True
            self._lose(f"{_WHO} reads no messages")
        except ConnectionError:
            self._lose(f"{_WHO} has ended, or vents because the driver stood still")


def end(supervisor: Supervisor | None, who: str, vented: bool) -> None:
    """End the supervisor; if none runs and the arm may have pressure, warn.

    Parameters
    ----------
    supervisor : Supervisor or None
        Process to end.
    who : str
        Name of the devices in the warning.
    vented : bool
        Whether readings have shown every chamber empty.
    """
    is_there = supervisor is not None and supervisor.is_alive
    if supervisor is not None:
        supervisor.dismiss(vented)
    if not (vented or is_there):
        logging.getLogger(__name__).warning(
            "%s: the driver ended and has not seen the arm empty: open the dump valve", who
        )


def running(supervisor: Supervisor | None) -> Supervisor:
    """Return a supervisor that waits for the driver's end: the given one, or a new one.

    One that already vents ends first: it takes answers of the connection that it shares with the driver.
    """
    if supervisor is not None and supervisor.watches(False):  # the next steps may take seconds, at 0 Pa
        return supervisor
    if supervisor is not None:
        supervisor.dismiss()
    return Supervisor()
