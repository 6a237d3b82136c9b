"""The folder that a run or a report is put in."""

from __future__ import annotations

import time
from pathlib import Path

from soro_core.errors import ConfigError, SoroError


def new_folder(parent: Path, name: str) -> Path:
    """Make ``parent/NAME-TIME``.

    Raises
    ------
    ConfigError
        If the parent cannot be written to.
    """
    stamp = time.strftime("%Y%m%d-%H%M%S")
    for suffix in ("", *(f"-{k}" for k in range(2, 100))):
        folder = parent / f"{name}-{stamp}{suffix}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            allowed = f"a folder that can be written to ({error.strerror})"
            raise ConfigError("--folder", "", str(parent), allowed) from None
        return folder
    raise SoroError(f"no free name for a run in {parent}")
