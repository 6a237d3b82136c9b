"""Versions: of soro, and of the programs that take part in a run, for its recording and its report."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from xml.etree import ElementTree

from soro_core.config import config_folder

_PACKAGES = ("numpy", "scipy", "numba", "mcap")


def soro_version() -> str:
    """Return the version of soro by package.xml, which is beside the sources and in every installation.

    The metadata of a package are those of its last installation, and absent where colcon installs.
    """
    text = ElementTree.parse(config_folder().parent / "package.xml").findtext("version")
    assert text is not None
    return text


def versions() -> dict[str, str]:
    """Return the versions of python, of soro and of the packages that a run computes with."""
    found = {"python": platform.python_version(), "soro": soro_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
