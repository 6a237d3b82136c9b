"""The folder of compiled kernels: one for each state of the sources, those long unused removed.

Numba is not imported here, so that a folder is found and kept without its start-up.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

PREFIX = "kernels-"
UNUSED_S = 30 * 86400.0
"""A folder that no process has asked for in this time is removed."""


def kernel_folder(version: str) -> Path:
    """Return a writable folder for kernels of this version: in the user's cache, else in the temp folder.

    Marks it as used now, and removes those of other versions that were not used for `UNUSED_S`.
    """
    user = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    # Two users of one machine must not meet in the same temp folder.
    me = os.getuid() if hasattr(os, "getuid") else 0
    for root in (Path(user) / "soro", Path(tempfile.gettempdir()) / f"soro-{me}"):
        folder = root / f"{PREFIX}{version}"
        try:
            root.mkdir(parents=True, exist_ok=True)
            with locked(root / "kernels.lock") as alone:
                folder.mkdir(exist_ok=True)
                os.utime(folder)
                stale = _set_aside(root, folder) if alone else []
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError:
            continue
        for old in stale:
            shutil.rmtree(old, ignore_errors=True)
        return folder
    return Path(tempfile.mkdtemp(prefix="soro-"))


@contextlib.contextmanager
def locked(path: Path) -> Iterator[bool]:
    """Hold a lock between processes; gives False, and holds nothing, where the system has none."""
    try:
        import fcntl
    except ImportError:  # not a POSIX system
        yield False
        return
    with path.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError:  # a network folder without locks
            yield False
            return
        yield True


def _set_aside(root: Path, used: Path) -> list[Path]:
    """Rename the folders that are out of use, and return their new names: to be removed without the lock.

    Whoever wants one of them waits for the lock to mark it: before the look at its age, which then keeps it,
    or after the renaming, and makes a new one. What was set aside by a process that ended then goes as well.
    """
    stale = list(root.glob(f"unused-{PREFIX}*"))
    for folder in root.glob(f"{PREFIX}*/"):
        aside = folder.with_name(f"unused-{folder.name}-{os.getpid()}")
        with contextlib.suppress(OSError):  # another user's, or gone
            if folder != used and time.time() - folder.stat().st_mtime > UNUSED_S:
                folder.rename(aside)
                stale.append(aside)
    return stale
