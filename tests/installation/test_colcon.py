"""What `colcon build` reads of setup.py, asked for in its way, and what it installs if there is a colcon."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.installation.source_tree import ROOT, copy_sources

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


@pytest.mark.process
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
    assert {str(file.relative_to(ROOT)) for file in (ROOT / "config/scenes").iterdir()} <= linked


@pytest.fixture(scope="module")
def colcon():
    found = shutil.which(os.environ.get("COLCON", "colcon"))
    return str(Path(found).absolute()) if found else pytest.skip("no colcon: `make colcon` installs it")


@pytest.mark.parametrize("options", [(), ("--symlink-install",)], ids=["copies", "links"])
def test_colcon_installs_nodes_and_files(colcon, tmp_path, options):
    source = tmp_path / "src/soro"
    copy_sources(source)
    build = ["build", "--packages-select", "soro_ros", *options]
    done = subprocess.run([colcon, *build], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    installed = tmp_path / "install/soro_ros"
    for name in (
        "config/robots/tue_three_bellow.yaml",
        "package.xml",
        "launch/arm.launch.py",
        "params/arm.yaml",
    ):
        assert (installed / "share/soro_ros" / name).is_file(), name
    # A copy runs with the python of the environment that is active, a link with that of colcon.
    python, node = Path(sys.executable).parent, installed / "lib/soro_ros/controller"
    command = f"python3 {installed}/bin/soro_controller" if options else str(node)
    run = f". install/setup.sh && PATH={python}:$PATH && exec {command} --help"
    assert os.access(node, os.X_OK)
    done = subprocess.run(["sh", "-c", run], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.startswith("usage: soro_controller"), done.stderr
