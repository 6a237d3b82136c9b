"""The driver's end of the supervisor process (`soro_core.hardware.supervisor`)."""

from __future__ import annotations

import contextlib
import json
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
START_LIMIT_S = 10.0
_END_LIMIT_S = 2.0

LOST = Fault("supervisor_lost", "supervisor", "the process that vents in need has ended", latched=True)


@dataclass(frozen=True)
class VentPlan:
    """What empties the arm on one line, and what shows that it has; see `soro_core.hardware.supervisor`."""

    name: str
    steps: tuple[dict[str, Any], ...]
    timeout_s: float
    longest_s: float
    least_s: float = 0.0
    begin: str = ""


class Supervisor:
    """A process that vents when this one dies.

    Raises
    ------
    HardwareError
        If it cannot be started.
    """

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._control.settimeout(START_LIMIT_S)
        self._is_ready = self._pressed = False
        try:
            # Isolated, and in a session of its own: what is sent to the driver's group is not for it.
            self._process: subprocess.Popen[bytes] = subprocess.Popen(
                [sys.executable, "-I", "-S", str(SCRIPT)],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                start_new_session=True,
                cwd="/",
            )
        except OSError as error:
            self._control.close()
            raise HardwareError(f"supervisor: cannot start ({reason(error)})") from None
        finally:
            theirs.close()

    @property
    def is_alive(self) -> bool:
        """Whether it would act."""
        return self._process.poll() is None

    def watches(self, pressed: bool) -> bool:
        """Tell it that this process is at work, and whether it asks for pressure; whether it would act.

        While pressure is asked for it vents when this is not called for 0.3 s.
        """
        try:
            if pressed or self._pressed:
                self._control.send(b"+" if pressed else b"-", socket.MSG_DONTWAIT)
        except OSError:  # gone, or so long asleep that there is no more room
            return False
        self._pressed = pressed
        return self.is_alive

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def wait_until_ready(self) -> None:
        """See that it listens.

        Raises
        ------
        HardwareError
            If it does not.
        """
        if self._is_ready:
            return
        try:
            self._is_ready = bool(self._control.recv(16))
        except OSError:  # a time-out is one
            self._is_ready = False
        if not self._is_ready:
            raise HardwareError(f"supervisor: not ready within {START_LIMIT_S:g} s")

    def hold(self, plan: Sequence[VentPlan], descriptors: Sequence[int]) -> None:
        """Share the descriptor of each line and say what to do there; in place of all before.

        When it has gone, `is_alive` says so, not this.

        Raises
        ------
        HardwareError
            If they cannot be handed over: it would be alive and hold nothing.
        """
        self.wait_until_ready()
        message = json.dumps([asdict(line) for line in plan]).encode()
        try:
            socket.send_fds(self._control, [message], descriptors)
        except ConnectionError:
            pass
        except OSError as error:
            raise HardwareError(f"supervisor: cannot be given the ports ({reason(error)})") from None

    def let_go(self) -> None:
        """Have it close what it holds."""
        self._say(b"[]")

    def dismiss(self, vented: bool = True) -> None:
        """End it: at once, or, where the arm is not known to be empty, by itself after it has tried."""
        self._say(b"end" if vented else b"left")
        self._control.close()
        try:
            self._process.wait(_END_LIMIT_S)
        except subprocess.TimeoutExpired:
            if vented:
                self._process.kill()
                self._process.wait()

    def _say(self, message: bytes) -> None:
        with contextlib.suppress(OSError):
            self._control.send(message)


def running(supervisor: Supervisor | None) -> Supervisor:
    """Return a supervisor that is alive: the given one, or a new one in its place."""
    if supervisor is not None and supervisor.is_alive:
        return supervisor
    if supervisor is not None:
        supervisor.dismiss()
    return Supervisor()
