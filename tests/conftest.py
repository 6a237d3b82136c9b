"""Shared fixtures: reference data that a checkout may or may not have beside it."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder with golden results and measured data; the test is skipped where it is absent."""
    folder = Path(os.environ.get("SORO_SHARED", ROOT.parent / "shared"))
    if not (folder / "golden").is_dir():
        pytest.skip(f"reference data not found in {folder} (set SORO_SHARED)")
    return folder


@pytest.fixture(scope="session")
def data(shared: Path) -> Path:
    """Folder with measured data of real robots (SORO_DATA overrides)."""
    return Path(os.environ.get("SORO_DATA", shared / "data"))
