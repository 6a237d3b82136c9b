"""The one import of numba: fixed flags, and a cache that can never be stale.

numba keys a cached kernel by its own file only; when a callee in another file changes, the old machine
code would be used. So the cache folder is named by a hash of all kernel sources, and set before the first
kernel is defined.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba import config as numba_config

Function = TypeVar("Function", bound=Callable[..., Any])


def source_hash() -> str:
    """Hash of every source file of the package that holds or feeds kernels, and of what compiles them."""
    package = Path(__file__).resolve().parent
    digest = hashlib.sha256()
    digest.update(f"{numba.__version__} {np.__version__} {platform.python_version()}".encode())
    kernels = [path for path in package.rglob("*.py") if b"soro_core._jit" in path.read_bytes()]
    # Whole folders: a table that kernels read may lie in a file without any.
    folders = {path.parent for path in kernels} - {package}
    feeding = {path for folder in folders for path in folder.glob("*.py")} | set(package.glob("_*.py"))
    for path in sorted(feeding):
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder() -> Path:
    """Return a writable folder for compiled kernels: the user's cache, else one below the temp folder."""
    name = f"kernels-{source_hash()}"
    user = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    # Two users of one machine must not meet in the same temp folder.
    me = os.getuid() if hasattr(os, "getuid") else 0
    for root in (Path(user) / "soro", Path(tempfile.gettempdir()) / f"soro-{me}"):
        folder = root / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return folder
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix="soro-"))


numba_config.CACHE_DIR = str(_cache_folder())


@contextlib.contextmanager
def compiling_once() -> Iterator[None]:
    """Let one process at a time compile; the others then find its kernels in the cache.

    Several nodes that start together would each compile the same kernels, each slower for the others.
    """
    try:
        import fcntl
    except ImportError:  # not a POSIX system: compile side by side
        yield
        return
    with (Path(numba_config.CACHE_DIR) / "compiling.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


# No fast-math: it deletes isnan and reorders sums. error_model="numpy": a division by zero gives inf,
# which the checks at the end of a step catch. nogil: the other threads of a node run on.
_FLAGS = {"cache": True, "fastmath": False, "error_model": "numpy", "nogil": True}


def kernel(function: Function) -> Function:
    """Compile a function that Python calls. With NUMBA_DISABLE_JIT=1 the plain function stays."""
    return cast(Function, numba.njit(**_FLAGS)(function))


def inner(function: Function) -> Function:
    """Compile a function that only other kernels call: without the slow entry from Python."""
    return cast(Function, numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_FLAGS)(function))


def entry(function: Function) -> Function:
    """Compile a short function that Python calls on a `soro_core._box.Box`.

    It keeps the interpreter's lock: the workspace in the box serves one thread at a time.
    """
    return cast(Function, numba.njit(**{**_FLAGS, "nogil": False})(function))
