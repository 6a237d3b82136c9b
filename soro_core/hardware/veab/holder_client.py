"""The driver's end of `soro_core.hardware.veab.holder`."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
from pathlib import Path

from soro_core.errors import HardwareError

SCRIPT = Path(__file__).with_name("holder.py")
START_LIMIT_S = 10.0
_END_LIMIT_S = 2.0


class Holder:
    """A process that shares the connection to the server and vents when this one dies.

    Parameters
    ----------
    ports : int
        Ports of the server.
    vented_pa : float
        Pressure below which a port counts as vented.

    Raises
    ------
    HardwareError
        If it cannot be started.
    """

    def __init__(self, ports: int, vented_pa: float) -> None:
        self._control, theirs = socket.socketpair()
        arguments = [sys.executable, "-I", "-S", str(SCRIPT), str(ports), str(vented_pa)]
        try:
            # Isolated, and in a session of its own: what is sent to the driver's group is not for it.
            self._process: subprocess.Popen[bytes] = subprocess.Popen(
                arguments,
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                start_new_session=True,
                cwd="/",
            )
            self._control.settimeout(START_LIMIT_S)
            if not self._control.recv(16):
                raise OSError("it has ended at once")
        except OSError as error:
            self._control.close()
            raise HardwareError(f"supervisor: cannot start ({error})") from None
        finally:
            theirs.close()

    @property
    def is_alive(self) -> bool:
        """Whether it would act."""
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def take(self, descriptor: int) -> None:
        """Share a connection, in place of an older one."""
        self._say(b"take\n", [descriptor])

    def drop(self) -> None:
        """Let the connection go."""
        self._say(b"drop\n", [])

    def dismiss(self, vented: bool) -> None:
        """End it: at once, or, where the arm is not known to be empty, by itself after it has tried."""
        if vented:
            self._say(b"end\n", [])
        self._control.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_LIMIT_S)

    def _say(self, word: bytes, descriptors: list[int]) -> None:
        with contextlib.suppress(OSError):  # `is_alive` says so
            socket.send_fds(self._control, [word], descriptors)
