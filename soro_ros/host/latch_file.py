"""A note on this machine that records why devices are vented, for the next driver of these devices."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path


def state_folder() -> Path:
    """Return ``$XDG_STATE_HOME/soro``, by default ``~/.local/state/soro``; it may not exist."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "soro"


class LatchFile:
    """The note about the devices at one address: it exists while a driver uses them, and after a vent.

    Parameters
    ----------
    device : str
        Path or address. A bare pseudo-terminal has no note: its number is the next emulator's.
    """

    def __init__(self, device: str) -> None:
        place = os.path.abspath(device) if device.startswith(("/", ".")) else device
        name = hashlib.sha256(place.encode()).hexdigest()[:16]
        self._file = None if place.startswith("/dev/pts/") else state_folder() / "latched" / name

    def cause(self) -> str | None:
        """Return why the last driver left the devices vented; None without a note. An empty note counts."""
        if self._file is None:
            return None
        try:
            text = self._file.read_text(encoding="utf-8", errors="replace").strip()
        except FileNotFoundError:
            return None
        except OSError as error:
            return f"the note of the last driver cannot be read: {error}"
        return text or "the last driver left them vented"

    def write(self, cause: str) -> None:
        """Write a cause; raises OSError if that fails."""
        if self._file is not None:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            beside = self._file.with_suffix(f".{os.getpid()}")
            beside.write_text(f"{cause}\n", encoding="utf-8")
            beside.replace(self._file)

    def clear(self) -> None:
        """Remove the note; raises OSError if that fails."""
        if self._file is not None:
            self._file.unlink(missing_ok=True)
