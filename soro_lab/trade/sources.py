"""Hash of all source files that results depend on."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

import scipy

from soro_core import _jit

# Folders that results may depend on: the arm, its laws, its loop, and what scenes and studies say of them.
_PARTS = ("soro_core", "soro_lab/scene", "soro_lab/trade", "soro_lab/identification")


@lru_cache(maxsize=1)
def sources() -> str:
    """Return the hash of all source files that results depend on, and of the versions of numba and scipy."""
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256(f"{_jit.source_hash()} {scipy.__version__}".encode())
    for path in source_files(root):
        digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def source_files(root: Path) -> list[Path]:
    """Return the source files that results depend on; `root` holds the packages."""
    return [path for part in _PARTS for path in sorted((root / part).rglob("*.py"))]
