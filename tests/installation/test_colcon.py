"""What `colcon build` reads of setup.py, asked for in its way."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

pytest.importorskip("setuptools", reason="setuptools is not installed; colcon brings it")

# The attributes of the distribution as text, which colcon-python-setup-py reads back as literals.
ASK = """
import setuptools
from distutils.core import run_setup
setup = run_setup("setup.py", script_args=("--dry-run",), stop_after="config")
skipped = ("cmdclass", "distclass", "ext_modules", "metadata", *setup.display_option_names)
found = {
    key: value for key, value in vars(setup).items()
    if not (key.startswith("_") or callable(value) or key in skipped)
}
unread = ("license_files", "provides_extras")
found["metadata"] = {key: value for key, value in vars(setup.metadata).items() if key not in unread}
print(repr(found))
"""


def test_colcon_reads_the_attributes_back():
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", ASK], cwd=ROOT, capture_output=True, text=True, check=True
    )
    found = ast.literal_eval(done.stdout)
    assert "soro_core.model" in found["packages"]
    assert found["entry_points"]["console_scripts"]
    # With --symlink-install, colcon builds in a folder of links to the packages and to these files.
    linked = {source for _, sources in found["data_files"] for source in sources}
    assert {"pyproject.toml", "README.md", "package.xml", "config/robots/tue_three_bellow.yaml"} <= linked
