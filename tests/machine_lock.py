"""Locks between the test runs of one machine, whoever starts them."""

import fcntl
import os
import stat
import tempfile
from pathlib import Path
from typing import BinaryIO


def machine_lock(name: str, waits: bool) -> BinaryIO | None:
    """Take the lock of a name; close what is returned to give it back.

    The file is in the temp folder, where others may have put anything: a link is not followed, nothing is
    written, and a file of another user is locked as it is.

    Returns
    -------
    BinaryIO or None
        None where the lock is taken (and `waits` is false), or where its file is none.
    """
    path = Path(tempfile.gettempdir()) / f"soro-test-{name}.lock"
    try:
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        except FileNotFoundError:
            descriptor = os.open(path, os.O_RDONLY | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError:
        return None
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if waits else fcntl.LOCK_NB))
    except OSError:
        os.close(descriptor)
        return None
    return os.fdopen(descriptor, "rb")
