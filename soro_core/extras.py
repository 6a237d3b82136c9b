"""Packages that not every installation has: a missing one becomes one line with the command to install it.

`pip install soro` brings the model and the command line. CAN, serial lines and Modbus are the extra
`hardware`, ROS and recordings the extra `ros`; `all` has these and more (docs/adr/0024-extras.md).

`lazy` makes public names load their module at first use (PEP 562): a command that only reads a file, or a
process that only transfers bytes, must not load numba and scipy.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from soro_core.errors import ConfigError


def lazy(package: str, homes: Mapping[str, str]) -> tuple[list[str], Callable[[str], Any]]:
    """Return ``__all__`` and ``__getattr__`` of a package; its ``dir`` has these names alone, for completion.

    Parameters
    ----------
    package : str
        Name of the package, from which relative modules are taken.
    homes : mapping
        The public names of each module that has some, separated by spaces.
    """
    modules = {name: module for module, names in homes.items() for name in names.split()}

    def get(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(modules[name], package), name)

    space = vars(sys.modules[package])
    space["__dir__"] = lambda: sorted({*(name for name in space if name.startswith("__")), *modules})
    return sorted(modules), get


# Packages of each extra, by the name that is imported; "" is what every installation has.
PACKAGES = {
    "": ("numpy", "scipy", "numba", "pydantic", "yaml", "typer", "rich", "matplotlib", "jinja2"),
    "hardware": ("can", "serial", "pymodbus"),
    "ros": (
        "rclpy",
        "builtin_interfaces",
        "diagnostic_msgs",
        "geometry_msgs",
        "lifecycle_msgs",
        "nav_msgs",
        "rcl_interfaces",
        "rosgraph_msgs",
        "sensor_msgs",
        "std_msgs",
        "std_srvs",
        "trajectory_msgs",
        "visualization_msgs",
        "mcap",
        "lz4",
        "zstandard",
        "rosbags",
    ),
    "board": ("smbus2",),
    "dask": ("distributed",),
    "parquet": ("pyarrow",),
    "design": ("ipctk", "meshio"),
    "mesh": ("netgen",),
    "multigrid": ("pyamg",),
    "pardiso": ("pypardiso",),
    "view": ("viser", "websockets", "msgspec"),
}
EXTRA_OF = {package: extra for extra, packages in PACKAGES.items() for package in packages}
# Where the name on the package index is another one.
INDEX_NAMES = {"can": "python-can", "serial": "pyserial", "yaml": "PyYAML", "netgen": "netgen-mesher"}


class MissingPackageError(ConfigError):
    """A package that a command needs is not installed.

    Parameters
    ----------
    package : str
        Name that was imported.
    extras : tuple of str
        Extras of soro to install; () for one package of an installation that has the others.
    """

    def __init__(self, package: str, extras: tuple[str, ...]) -> None:
        self.package, self.extras = package, extras
        name = INDEX_NAMES.get(package, package)
        wanted = "all" if set(extras) >= {"hardware", "ros"} else ",".join(extras)
        install = f"'soro[{wanted}]'" if wanted else "soro" if extras else name
        line = f"the package {name} is not installed: pip install {install}"
        super().__init__("installation", package, None, install)
        self.args = (line,)


def require(*extras: str) -> None:
    """Check that the packages of extras are installed, without importing them.

    Raises
    ------
    MissingPackageError
        One line that names the first package that is missing, and every extra that lacks one.
    """
    missing = [name for extra in extras for name in PACKAGES[extra] if not find_spec(name)]
    if missing:
        raise _missing(missing[0], tuple(dict.fromkeys(EXTRA_OF[name] for name in missing)))


@contextlib.contextmanager
def named_packages() -> Iterator[None]:
    """Turn the failed import of an optional package into `MissingPackageError`."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRA_OF:
            raise
        raise _missing(package, (EXTRA_OF[package],)) from None


def _missing(package: str, extras: tuple[str, ...]) -> MissingPackageError:
    """Name the extras; or the package alone, beside a ROS that was installed otherwise or without the model.

    The wheels of ROS must not join another ROS, and a board that was installed without numba needs none.
    """
    has_own_ros = "ros" in extras and package != "rclpy" and find_spec("rclpy")
    is_board = "board" in extras and not find_spec("numba")
    return MissingPackageError(package, () if has_own_ros or is_board else extras)
