"""What a shell offers after TAB: names of shipped files, and folders of runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from soro_core.config import config_folder


def names_of(*kinds: str) -> Callable[[str], list[str]]:
    """Return the completion of names of shipped files.

    Parameters
    ----------
    *kinds : str
        Folders in ``config/``: robots, platforms, scenes.
    """

    def complete(incomplete: str) -> list[str]:
        found = (file.stem for kind in kinds for file in (config_folder() / kind).glob("*.yaml"))
        return sorted(name for name in found if name.startswith(incomplete))

    return complete


def run_folders(incomplete: str) -> list[str]:
    """Complete the folder of a run, the newest first; without one, the shell offers files."""
    folders = [folder for folder in Path("runs").glob("*/") if str(folder).startswith(incomplete)]
    return [str(folder) for folder in sorted(folders, key=lambda folder: -folder.stat().st_mtime)]
