"""The one import of numba: fixed flags, and a cache that can never be stale.

numba keys a cached kernel by its own file only; when a callee in another file changes, the old machine
code would be used. So the cache folder is named by a hash of all kernel sources, and set before the first
kernel is defined.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import multiprocessing
import platform
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba import config as numba_config
from numba.core import event

from soro_core._linked import linked
from soro_core.files.kernel_folder import kernel_folder, locked

Function = TypeVar("Function", bound=Callable[..., Any])

# Packages that hold kernels; they stand side by side.
PACKAGES = ("soro_core", "soro_design")


def source_hash() -> str:
    """Hash of every source file that holds or feeds kernels, of all packages, and of what compiles them."""
    package = Path(__file__).resolve().parent
    beside = package.parent
    digest = hashlib.sha256()
    digest.update(f"{numba.__version__} {np.__version__} {platform.python_version()}".encode())
    files = (path for name in PACKAGES for path in (beside / name).rglob("*.py"))
    kernels = [path for path in files if b"soro_core._jit" in path.read_bytes()]
    # Whole folders: a table that kernels read may lie in a file without any.
    folders = {path.parent for path in kernels} - {package}
    feeding = {path for folder in folders for path in folder.glob("*.py")} | set(package.glob("_*.py"))
    for path in sorted(feeding):
        digest.update(path.relative_to(beside).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


numba_config.CACHE_DIR = str(kernel_folder(source_hash()))
LOCK = Path(numba_config.CACHE_DIR) / "compiling.lock"
"""Held while a process compiles."""

# Time between two lines of progress [s].
PROGRESS_S = 10.0
# Names of the functions that are compiled when they are called first.
_defined: set[tuple[str, str]] = set()


class _Announcement(event.Listener):  # type: ignore[misc]
    """Logs (by default to stderr) that kernels are compiled, which makes a first start slow, and how far.

    Numba announces what it compiles, not what it finds in the cache.
    """

    def __init__(self) -> None:
        self.done: set[tuple[str, str]] = set()
        self.is_logged, self.told_s, self.heard_s = False, 0.0, 0.0

    def on_start(self, event: Any) -> None:
        if _name(event) not in _defined:
            return
        now_s = time.monotonic()
        if now_s - self.heard_s > PROGRESS_S:  # nothing was compiled meanwhile
            self.told_s = now_s
        self.heard_s = now_s
        # The process that started a worker logs it in the worker's place.
        if self.is_logged or multiprocessing.parent_process() is not None:
            return
        self.is_logged = True
        logging.getLogger("soro_core").warning(
            "soro: compiling the model's kernels, once (some minutes of processor time, cached in %s)",
            numba_config.CACHE_DIR,
        )

    def on_end(self, event: Any) -> None:
        name, now_s = _name(event), time.monotonic()
        if name not in _defined:
            return
        self.done.add(name)
        self.heard_s = now_s
        if self.is_logged and now_s - self.told_s > PROGRESS_S:
            self.told_s = now_s
            logging.getLogger("soro_core").warning(
                "soro: compiling: %d functions done, of at most %d", len(self.done), len(_defined)
            )


def _name(event: Any) -> tuple[str, str]:
    """Return module and name of what is compiled; functions that numba makes up have no module."""
    return _key(getattr(event.data.get("dispatcher"), "py_func", None))


def _key(function: Any) -> tuple[str, str]:
    return str(getattr(function, "__module__", "")), str(getattr(function, "__qualname__", ""))


event.register("numba:compile", _Announcement())


@contextlib.contextmanager
def compiling_once() -> Iterator[None]:
    """Hold the lock under which one process at a time compiles; the others find its kernels in the cache.

    Without it, nodes that start together compile the same kernels at the same time.
    """
    with locked(LOCK):
        yield


# No fast-math: it deletes isnan and reorders sums. error_model="numpy": a division by zero gives inf,
# which the checks at the end of a step catch. nogil: the other threads of a node run on.
_FLAGS = {"cache": True, "fastmath": False, "error_model": "numpy", "nogil": True}


def kernel(function: Function) -> Function:
    """Compile a function that Python calls; with NUMBA_DISABLE_JIT=1 return it as it is."""
    _defined.add(_key(function))
    return cast(Function, numba.njit(**_FLAGS)(function))


def inner(function: Function) -> Function:
    """Compile a function that only other kernels call, to be linked into them (`soro_core._linked`)."""
    _defined.add(_key(function))
    return cast(Function, linked(function, **{**_FLAGS, "cache": False}))


def entry(function: Function) -> Function:
    """Compile a short function that Python calls on a `soro_core._box.Box`.

    It keeps the interpreter's lock: the workspace in the box serves one thread at a time.
    """
    _defined.add(_key(function))
    return cast(Function, numba.njit(**{**_FLAGS, "nogil": False})(function))
