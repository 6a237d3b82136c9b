"""Control socket of an emulator: faults come in as lines of YAML, each is answered by one line.

The first word of an answer is ``ok`` or ``error``; ``list`` asks for what is active or waits.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
from pathlib import Path

from soro_core.errors import ConfigError, HardwareError
from soro_core.hardware.emulation.faults import Faults, Injection, read_injection
from soro_core.hardware.emulation.unix_socket import UnixListener
from soro_core.hardware.reason import reason

_LONGEST = 4096


class ControlServer:
    """The emulator's end.

    Parameters
    ----------
    path : str or Path
        Unix socket to listen on; one left by a process that was killed is replaced.
    faults : Faults
        Where the faults go.
    selector : selector
        The loop that calls back when something has come.

    Raises
    ------
    HardwareError
        If the socket cannot be made.
    """

    def __init__(self, path: str | Path, faults: Faults, selector: selectors.BaseSelector) -> None:
        self._faults, self._selector = faults, selector
        self._clients: dict[socket.socket, bytes] = {}
        self._listener = UnixListener(path, "faults")
        selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def close(self) -> None:
        """Close everything and take the socket's file away."""
        for client in list(self._clients):
            self._drop(client)
        self._selector.unregister(self._listener)
        self._listener.close()

    def _accept(self) -> None:
        if (client := self._listener.accept()) is not None:
            self._clients[client] = b""
            self._selector.register(client, selectors.EVENT_READ, lambda: self._read(client))

    def _read(self, client: socket.socket) -> None:
        try:
            chunk = client.recv(_LONGEST)
        except BlockingIOError:
            return
        except OSError:
            chunk = b""
        *lines, rest = (self._clients[client] + chunk).split(b"\n")
        if not chunk or len(rest) > _LONGEST:
            self._drop(client)
            return
        self._clients[client] = rest
        for line in lines:
            answer = answer_to(self._faults, line.decode("utf-8", "replace"))
            with contextlib.suppress(OSError):  # who does not read its answers goes without
                client.send(f"{answer}\n".encode())

    def _drop(self, client: socket.socket) -> None:
        self._selector.unregister(client)
        client.close()
        del self._clients[client]


def answer_to(faults: Faults, line: str) -> str:
    """Do what a line asks for."""
    if line.strip() == "list":
        waiting = [f"{injection} in {seconds:.1f} s" for injection, seconds in faults.waiting]
        return f"ok: {'; '.join([*map(str, faults.active), *waiting]) or 'no faults'}"
    try:
        injection = read_injection(line)
        faults.add(injection)
    except ConfigError as error:
        return f"error: {error}"
    return f"ok: {injection}"


class ControlClient:
    """A client's end, blocking for at most `timeout_s` an answer.

    Raises
    ------
    HardwareError
        If there is no emulator, or it does not answer.
    """

    def __init__(self, path: str | Path, timeout_s: float = 2.0) -> None:
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(timeout_s)
        try:
            self._socket.connect(str(path))
        except OSError as error:
            self._socket.close()
            raise HardwareError(f"{path}: no emulator listens for faults ({reason(error)})") from None
        self._lines = self._socket.makefile("r", encoding="utf-8")

    def inject(self, fault: Injection | str) -> str:
        """Inject a fault; what the emulator made of it.

        Raises
        ------
        HardwareError
            If the emulator refuses the fault, with its reason, or does not answer.
        """
        text = fault.as_text() if isinstance(fault, Injection) else " ".join(fault.split())
        try:
            self._socket.sendall(f"{text}\n".encode())
            answer = self._lines.readline().strip()
        except OSError as error:
            raise HardwareError(f"{self._path}: the emulator does not answer ({reason(error)})") from None
        if not answer:
            raise HardwareError(f"{self._path}: the emulator has gone")
        verdict, _, said = answer.partition(": ")
        if verdict != "ok":
            raise HardwareError(said)
        return said

    def close(self) -> None:
        """Close the connection."""
        self._lines.close()
        self._socket.close()
