"""Hash of all source files that results depend on."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

import scipy

# Not by the module's full name, which marks a folder of kernels: this one has none.
from soro_core import _jit

# Packages that only record, or communicate with devices; results may depend on all others.
_APART = ("bag", "hardware")


@lru_cache(maxsize=1)
def sources() -> str:
    """Return the hash of all source files that results depend on, and of the versions of numba and scipy."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(f"{_jit.source_hash()} {scipy.__version__}".encode())
    for path in source_files(package):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def source_files(package: Path) -> list[Path]:
    """Return the source files of the package that results depend on."""
    return [p for p in sorted(package.rglob("*.py")) if p.relative_to(package).parts[0] not in _APART]
