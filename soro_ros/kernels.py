"""Whether the model's kernels are compiled, for people who wait for it."""

from __future__ import annotations

from pathlib import Path


def compiled() -> int:
    """Number of compiled kernels in the cache."""
    from soro_core._jit import numba_config  # loaded late: the first processes start meanwhile

    return sum(1 for _ in Path(numba_config.CACHE_DIR).rglob("*.nbc"))
