"""Control socket of an emulator: a client sends a fault as a line of YAML and gets one line as answer.

An answer starts with ``ok`` or ``error``. The line ``list`` asks for the active and the scheduled faults.
"""

from __future__ import annotations

import selectors
import socket
from pathlib import Path

from soro_core.errors import ConfigError, HardwareError
from soro_hardware.emulation.faults.fault_types import Injection, read_injection
from soro_hardware.emulation.faults.schedule import FaultSchedule
from soro_hardware.emulation.sockets.unix_socket import SocketClient, UnixServer
from soro_hardware.error_text import reason

_LONGEST = 4096


class ControlServer(UnixServer):
    """The emulator's end of the control socket.

    Parameters
    ----------
    path : str or Path
        Path of the Unix socket; the socket of a killed process is replaced.
    faults : FaultSchedule
        Faults to which the received ones are added.
    selector : selector
        Event loop that calls the server when bytes have arrived.

    Raises
    ------
    HardwareError
        If the socket cannot be made.
    """

    def __init__(self, path: str | Path, faults: FaultSchedule, selector: selectors.BaseSelector) -> None:
        self._faults = faults
        super().__init__(path, "faults", selector)

    def take(self, client: SocketClient) -> None:
        *lines, client.received = client.received.split(b"\n")
        if max(len(client.received), len(client.backlog)) > _LONGEST:
            raise ValueError("the line has no end, or the client does not read the answers")
        for line in lines:
            self.write(client, f"{answer_to(self._faults, line.decode('utf-8', 'replace'))}\n".encode())


def answer_to(faults: FaultSchedule, line: str) -> str:
    """Execute one line and return the answer."""
    if line.strip() == "list":
        waiting = [f"{injection} in {seconds:.1f} s" for injection, seconds in faults.waiting]
        return f"ok: {'; '.join([*map(str, faults.active), *waiting]) or 'no faults'}"
    try:
        injection = read_injection(line)
        faults.add(injection)
    except ConfigError as error:
        return f"error: {error}"
    return f"ok: {injection}"


_ANSWER_S = 2.0  # longest wait for an answer


class ControlClient:
    """A client's end of the control socket.

    Parameters
    ----------
    path : str or Path
        Path of the Unix socket.

    Raises
    ------
    HardwareError
        If no emulator listens, or it does not answer.
    """

    def __init__(self, path: str | Path) -> None:
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(_ANSWER_S)
        try:
            self._socket.connect(str(path))
        except OSError as error:
            self._socket.close()
            raise HardwareError(f"no emulator listens for faults ({reason(error)})", path, "open") from None
        self._lines = self._socket.makefile("r", encoding="utf-8")

    def inject(self, fault: Injection | str) -> str:
        """Inject a fault and return the emulator's description of it.

        Raises
        ------
        HardwareError
            If the emulator refuses the fault, with its reason, or does not answer.
        """
        line = fault.as_text() if isinstance(fault, Injection) else " ".join(fault.split())
        try:
            self._socket.sendall(f"{line}\n".encode())
            answer = self._lines.readline().strip()
        except OSError as error:
            raise HardwareError(
                f"the emulator does not answer ({reason(error)})", self._path, "silent"
            ) from None
        if not answer:
            raise HardwareError("the emulator has ended", self._path, "gone")
        verdict, _, text = answer.partition(": ")
        if verdict != "ok":
            raise HardwareError(text, code="setting")
        return text

    def close(self) -> None:
        """Close the connection."""
        self._lines.close()
        self._socket.close()
