"""What the results depend on: the text of every source file that makes them."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

from soro_core._jit import source_hash

# Besides the kernels, which `source_hash` has.
_PACKAGES = ("control", "estimation", "integrate", "model", "pneumatics", "robot", "trade", "twin")


@lru_cache(maxsize=1)
def sources() -> str:
    """Hash of every source file that the results depend on."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(source_hash().encode())
    for name in _PACKAGES:
        for path in sorted((package / name).rglob("*.py")):
            digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()
