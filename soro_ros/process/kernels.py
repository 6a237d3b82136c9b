"""How far kernels are compiled, for a progress message and for time limits."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator


def compiled() -> int:
    """Number of compiled kernels in the cache."""
    return sum(1 for _ in _files())


def none_is_compiled() -> bool:
    """Return whether the cache is empty."""
    return next(_files(), None) is None


def _files() -> Iterator[str]:
    # Imported late, so that the first processes start earlier; `_jit` names the folder.
    from numba import config

    import soro_core._jit  # noqa: F401

    # `Path.rglob` takes five times as long.
    return (name for _, _, names in os.walk(config.CACHE_DIR) for name in names if name.endswith(".nbc"))


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
