"""The folder of compiled kernels: one for each state of the sources, those long unused removed.

Numba unpickles the files of this folder, so only this user may have the right to write to it. This module
does not import numba, so that commands can use it without the start-up of numba.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from soro_core.files.private_folder import make_private

PREFIX = "kernels-"
UNUSED_S = 30 * 86400.0
"""Folders that no process has used for this time are removed [s]."""


def kernel_folder(version: str) -> Path:
    """Return a folder for kernels of this version: in the user's cache, else in the temp folder.

    The function marks the folder as used, and removes those of other versions that were not used for
    `UNUSED_S`. If neither place allows a private folder, it logs one line, and the folder exists as long as
    this process.
    """
    user = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    # Two users of one machine must not meet in the same temp folder.
    me = os.getuid() if hasattr(os, "getuid") else 0
    refused: list[str] = []
    for root in (Path(user) / "soro", Path(tempfile.gettempdir()) / f"soro-{me}"):
        folder = root / f"{PREFIX}{version}"
        try:
            root.parent.mkdir(parents=True, exist_ok=True)
            make_private(root, is_mended=True)
            with locked(root / "kernels.lock") as alone:
                make_private(folder)
                os.utime(folder)
                stale = _set_aside(root, folder) if alone else []
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            refused.append(f"{root}: {error.strerror or error}")
            continue
        for old in stale:
            shutil.rmtree(old, ignore_errors=True)
        return folder
    logging.getLogger("soro_core").warning(
        "soro: compiled kernels are not kept, each start compiles them again (%s); "
        "set XDG_CACHE_HOME to a folder of yours",
        ", ".join(refused),
    )
    passing = Path(tempfile.mkdtemp(prefix="soro-"))
    atexit.register(shutil.rmtree, passing, ignore_errors=True)
    return passing


@contextlib.contextmanager
def locked(path: Path) -> Iterator[bool]:
    """Hold a lock between processes; gives False, and holds nothing, where the system has none."""
    try:
        import fcntl
    except ImportError:  # not a POSIX system
        yield False
        return
    # O_NOFOLLOW: a link that another user has created is not followed, and no file is truncated.
    with os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600), "w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError:  # a network folder without locks
            yield False
            return
        yield True


def _set_aside(root: Path, used: Path) -> list[Path]:
    """Rename unused folders and return their new names; the caller removes them without the lock.

    A process that needs one of them holds the lock to mark it as used: either before its age is checked,
    which keeps the folder, or after the renaming, and then creates a new one. Folders that an ended process
    has renamed are returned too.
    """
    stale = list(root.glob(f"unused-{PREFIX}*"))
    for folder in root.glob(f"{PREFIX}*/"):
        aside = folder.with_name(f"unused-{folder.name}-{os.getpid()}")
        with contextlib.suppress(OSError):  # it belongs to another user, or does not exist any more
            if folder != used and time.time() - folder.stat().st_mtime > UNUSED_S:
                folder.rename(aside)
                stale.append(aside)
    return stale
