"""Versions: of soro, of the programs that take part in a run, and of what results depend on."""

from __future__ import annotations

import hashlib
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from xml.etree import ElementTree

from soro_core.config import config_folder

_PACKAGES = ("numpy", "scipy", "numba", "mcap")
# Those that change results.
_COMPUTING = _PACKAGES[:3]


def soro_version() -> str:
    """Return the version of soro by package.xml, which is beside the sources and in every installation.

    The metadata of a package are those of its last installation, and absent where colcon installs.
    """
    text = ElementTree.parse(config_folder().parent / "package.xml").findtext("version")
    assert text is not None
    return text


__version__ = soro_version()


def versions() -> dict[str, str]:
    """Return the versions of python, of soro and of the packages that a run computes with."""
    found = {"python": platform.python_version(), "soro": soro_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@lru_cache(maxsize=1)
def fingerprint() -> str:
    """Return what the same results need, as one text: soro, a hash of its sources, and what it computes with.

    The hash is of every source file of the five packages, kernels too.
    """
    beside, digest = Path(__file__).resolve().parents[2], hashlib.sha256()
    for package in sorted(beside.glob("soro_*/py.typed")):
        for path in sorted(package.parent.rglob("*.py")):
            digest.update(path.relative_to(beside).as_posix().encode() + path.read_bytes())
    found = versions()
    own = f"soro {found['soro']}, sources {digest.hexdigest()[:16]}, python {found['python']}"
    return ", ".join((own, *(f"{name} {found.get(name, '-')}" for name in _COMPUTING)))
