"""Listening on a Unix socket: one that a killed process left is replaced, one that lives is not."""

from __future__ import annotations

import contextlib
import os
import socket
import stat
from pathlib import Path

from soro_core.errors import HardwareError
from soro_core.hardware.reason import no_socket


class UnixListener:
    """A Unix socket that listens, with its file.

    Parameters
    ----------
    path : str or Path
        Of the file.
    what : str
        What is to be heard, for errors.

    Raises
    ------
    HardwareError
        If the file cannot be made, or another process listens there.
    """

    def __init__(self, path: str | Path, what: str) -> None:
        self.path = Path(path)
        if not self.path.parent.is_dir():
            raise HardwareError(f"{path}: cannot listen for {what} (there is no folder {self.path.parent})")
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            if self.path.exists() and stat.S_ISSOCK(self.path.stat().st_mode):
                if _answers(self.path):
                    raise HardwareError(f"{path}: cannot listen for {what} (another emulator listens there)")
                self.path.unlink()
            self._socket.bind(str(self.path))
            self._made = self.path.stat().st_ino
            self._socket.listen()
        except OSError as error:
            self._socket.close()
            raise HardwareError(f"{path}: cannot listen for {what} ({no_socket(error)})") from None
        except HardwareError:
            self._socket.close()
            raise
        self._socket.setblocking(False)

    def fileno(self) -> int:
        """Descriptor that is readable when a client waits."""
        return self._socket.fileno()

    def accept(self) -> socket.socket | None:
        """Take a client that waits; None where there is none."""
        with contextlib.suppress(BlockingIOError):
            client, _ = self._socket.accept()
            client.setblocking(False)
            return client
        return None

    def close(self) -> None:
        """Stop, and take the file away, unless another one stands there by now."""
        self._socket.close()
        with contextlib.suppress(OSError):
            if self.path.stat().st_ino == self._made:
                os.unlink(self.path)


def _answers(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as caller:
        caller.setblocking(False)
        try:
            caller.connect(str(path))
        except BlockingIOError:  # its backlog is full
            return True
        except OSError:
            return False
    return True
