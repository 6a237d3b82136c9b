"""The driver's end of the supervisor process (`soro_core.hardware.supervisor`)."""

from __future__ import annotations

import contextlib
import json
import logging
import socket
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from soro_core.errors import HardwareError
from soro_core.hardware.port import Fault
from soro_core.hardware.reason import reason

SCRIPT = Path(__file__).with_name("supervisor.py")
START_LIMIT_S = 30.0
_END_LIMIT_S = 2.0

LOST = Fault(
    "supervisor_lost", "supervisor", "the process that vents when the driver dies has ended", latched=True
)


@dataclass(frozen=True)
class VentPlan:
    """Messages that vent the devices of one line, with the answers that confirm it; see `supervisor`."""

    name: str
    steps: tuple[dict[str, Any], ...]
    timeout_s: float
    longest_s: float
    least_s: float = 0.0
    begin: str = ""


class Supervisor:
    """The supervisor: a process that vents when the driver's process dies.

    Raises
    ------
    HardwareError
        If it cannot be started.
    """

    def __init__(self) -> None:
        self.control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.control.settimeout(START_LIMIT_S)
        self._is_ready = self._pressed = self._is_gone = False
        try:
            # Isolated, and in its own session: signals to the driver's group do not reach it.
            self.process: subprocess.Popen[bytes] = subprocess.Popen(
                [sys.executable, "-I", "-S", str(SCRIPT)],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
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
        return not self._is_gone and self.process.poll() is None

    def watches(self, pressed: bool) -> bool:
        """Report that the driver works, and whether it commands pressure; return `is_alive`.

        While pressure is commanded, the process vents 0.3 s after the last call.
        """
        try:
            if pressed or self._pressed:
                self.control.send(b"+" if pressed else b"-", socket.MSG_DONTWAIT)
        except OSError:  # the process vents, has ended or does not read
            self._is_gone = True
        self._pressed = pressed
        return self.is_alive

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
        try:
            self._is_ready = bool(self.control.recv(16))
        except TimeoutError:
            raise HardwareError(f"not ready within {START_LIMIT_S:g} s", "supervisor", "silent") from None
        except OSError:  # of a process that has ended
            self._is_ready = False
        if not self._is_ready:
            raise HardwareError("its process ended at the start", "supervisor", "gone")

    def hold(self, plan: Sequence[VentPlan], descriptors: Sequence[int]) -> None:
        """Pass a plan and the descriptor of each line to the process, in place of the last plan.

        If the process has ended, the call does not raise; `is_alive` is then false.

        Raises
        ------
        HardwareError
            If the process runs and the descriptors cannot be passed.
        """
        self.wait_until_ready()
        message = json.dumps([asdict(line) for line in plan]).encode()
        try:
            socket.send_fds(self.control, [message], descriptors)
        except ConnectionError:
            pass
        except OSError as error:
            raise HardwareError(f"cannot receive the ports ({reason(error)})", "supervisor", "open") from None

    def release(self) -> None:
        """Make the process close its descriptors."""
        self._say(b"[]")

    def dismiss(self, vented: bool = True) -> None:
        """End the process at once, or, if the arm is not `vented`, after it has vented it."""
        self._say(b"end" if vented else b"left")
        self.control.close()
        try:
            self.process.wait(_END_LIMIT_S)
        except subprocess.TimeoutExpired:
            if vented:
                self.process.kill()
                self.process.wait()

    def _say(self, message: bytes) -> None:
        with contextlib.suppress(OSError):
            self.control.send(message)


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
