"""Folders to which only this user may write, so that their files come from this user."""

from __future__ import annotations

import contextlib
import os
import stat
from pathlib import Path

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def make_private(folder: Path, is_mended: bool = False) -> None:
    """Create a folder to which only this user may write, or check that an existing one is such a folder.

    Parameters
    ----------
    folder : Path
        The folder; its parent must exist. A user with the right to write to the parent could replace the
        folder, so a parent that is open to all needs the sticky bit, as the temporary folder has.
    is_mended : bool
        Remove the right to write of others instead of raising an error, for a folder whose files are checked
        one by one.

    Raises
    ------
    OSError
        If the path is a link or not a folder, belongs to another user, or others may write to it or replace
        it; or an error of the system.
    """
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode):
        raise NotADirectoryError("it is no folder, or a link to one")
    if not hasattr(os, "getuid"):  # not a POSIX system: its temp folder is the user's own
        return
    if found.st_uid != os.getuid():
        raise PermissionError("it belongs to another user")
    above = folder.parent.stat().st_mode
    if above & stat.S_IWOTH and not above & stat.S_ISVTX:
        raise PermissionError(f"others may replace it: chmod o-w {folder.parent}")
    if found.st_mode & _OTHERS_WRITE:
        if not is_mended:
            raise PermissionError("others may write in it: chmod go-w")
        folder.chmod(stat.S_IMODE(found.st_mode) & ~_OTHERS_WRITE)
