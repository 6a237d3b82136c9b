"""Number of compiled kernels, for a progress message."""

from __future__ import annotations

import os


def compiled() -> int:
    """Number of compiled kernels in the cache."""
    # Imported late, so that the first processes start earlier; `_jit` names the folder.
    from numba import config

    import soro_core._jit  # noqa: F401

    # A start calls this twenty times a second; `Path.rglob` takes five times as long.
    folders = os.walk(config.CACHE_DIR)
    return sum(name.endswith(".nbc") for _, _, names in folders for name in names)
