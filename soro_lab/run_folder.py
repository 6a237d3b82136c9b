"""The folder that a run or a report is put in, and the files of a run in it."""

from __future__ import annotations

import time
from pathlib import Path

from soro_core.errors import BagError, ConfigError, SoroError

_SCENES = ("scene_used.yaml", "scene.yaml")


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


def bag_of(run: Path) -> Path:
    """Return the bag of a run's folder; of a bag, itself."""
    return run / "bag" if (run / "bag").is_dir() else run


def bag_and_scene(run: Path) -> tuple[Path, Path]:
    """Return bag and scene of a run; the shipped recordings have both in one folder.

    Raises
    ------
    BagError
        If there is no such file or folder, or no scene.
    """
    if not run.exists():
        raise BagError("no such file or folder", run, "missing")
    for folder in (run, run.parent):
        for name in _SCENES:
            if (folder / name).exists():
                return bag_of(run), folder / name
    raise BagError(f"{run}: neither {' nor '.join(_SCENES)}, so that the robot is not known")


def run_folders(incomplete: str) -> list[str]:
    """Complete the folder of a run in a shell, the newest first; without one, the shell offers files."""
    folders = [folder for folder in Path("runs").glob("*/") if str(folder).startswith(incomplete)]
    return [str(folder) for folder in sorted(folders, key=lambda folder: -folder.stat().st_mtime)]
