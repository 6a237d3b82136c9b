"""Versions of the programs that take part in a run, for its recording and its report."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

_PACKAGES = ("soro", "numpy", "scipy", "numba", "mcap")


def versions() -> dict[str, str]:
    """Return the versions of python and of the packages that a run computes with."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # installed by colcon, which keeps no record of what it is
            continue
    return found
