"""The files that are built, copied so that a build leaves nothing in the repository."""

import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("soro_core", "soro_hardware", "soro_lab", "soro_design", "soro_ros")
PARTS = (*PACKAGES, "config", "lib", "resource", "params", "setup.py", "pyproject.toml")
PARTS += ("package.xml", "README.md", "LICENSE", "MANIFEST.in")


def copy_sources(folder: Path) -> None:
    """Copy what builds need into a folder that does not exist yet."""
    folder.mkdir(parents=True)
    for part in PARTS:
        copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copy2
        copy(ROOT / part, folder / part)
