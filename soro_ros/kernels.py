"""Number of compiled kernels, for a progress message."""

from __future__ import annotations

from pathlib import Path


def compiled() -> int:
    """Number of compiled kernels in the cache."""
    from soro_core._jit import numba_config  # imported late, so that the first processes start earlier

    return sum(1 for _ in Path(numba_config.CACHE_DIR).rglob("*.nbc"))
