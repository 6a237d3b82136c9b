"""How far kernels are compiled, for a progress message and for time limits."""

from __future__ import annotations

import contextlib
import os


def compiled() -> int:
    """Number of compiled kernels in the cache."""
    # Imported late, so that the first processes start earlier; `_jit` names the folder.
    from numba import config

    import soro_core._jit  # noqa: F401

    # A start calls this twenty times a second; `Path.rglob` takes five times as long.
    folders = os.walk(config.CACHE_DIR)
    return sum(name.endswith(".nbc") for _, _, names in folders for name in names)


def are_compiled_now() -> bool:
    """Return whether a process holds the lock under which kernels are compiled."""
    import fcntl

    from soro_core._jit import LOCK

    with contextlib.suppress(OSError), LOCK.open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False
