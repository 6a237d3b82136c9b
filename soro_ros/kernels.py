"""Whether the model's kernels are compiled, for people who wait for it."""

from __future__ import annotations

from pathlib import Path

from soro_core._jit import numba_config


def compiled() -> int:
    """Number of compiled kernels in the cache."""
    return sum(1 for _ in Path(numba_config.CACHE_DIR).rglob("*.nbc"))
