"""What the results depend on: the text of every source file that can make a difference to them."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

import scipy

# Not by the module's full name, which marks a folder of kernels: this one has none.
from soro_core import _jit

# What only records, or talks to devices; everything else may take part: loop, safety, scene, twin, ...
_APART = ("bag", "hardware")


@lru_cache(maxsize=1)
def sources() -> str:
    """Hash of every source file that the results depend on, and of what compiles and solves."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(f"{_jit.source_hash()} {scipy.__version__}".encode())
    for path in source_files(package):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def source_files(package: Path) -> list[Path]:
    """Those files of the package."""
    return [p for p in sorted(package.rglob("*.py")) if p.relative_to(package).parts[0] not in _APART]
