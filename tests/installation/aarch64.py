"""`make aarch64`: what runs on a Raspberry Pi or a Jetson, tried as far as the emulation of qemu goes.

Python for arm64 comes from the distribution of this machine, in a folder of its own; nothing is installed.
Packages come as wheels for aarch64 from PyPI. The tests of drivers and board that start no process run there,
and the model, whose numbers are compared with those of this processor.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
# What a machine beside an arm needs, and what its tests need; the ROS wheels are for x86-64 alone.
EXTRAS = ("hardware", "board", "view", "parquet")
TESTS_NEED = ("pytest", "pytest-timeout", "hypothesis", "canopen", "pyModbusTCP", "mcap")
PLATFORMS = ("manylinux_2_28_aarch64", "manylinux_2_27_aarch64", "manylinux2014_aarch64")
# The bytes of each family, the board and its chips: what differs between processors shows there first.
TESTS = (
    *("board_chips", "board_core", "board_driver", "board_frames", "canopen_mapping", "cia408", "slcan"),
    *("serial_alicat", "serial_itv", "tcp_transcripts", "transcripts", "veab", "vtem", "wire_properties"),
)
MODEL = """
import platform, numpy as np
from soro_core import SoftArm, equilibrium, load_robot
arm = SoftArm(load_robot("config/robots/tue_three_bellow.yaml"))
print(platform.machine(), np.array2string(equilibrium(arm, np.array([20e3, 5e3, 0.0])), precision=8))
"""


def main() -> None:
    """Make the environment in build/aarch64, run tests and model in it, and print what passed."""
    qemu = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
    if qemu is None or shutil.which("apt-get") is None:
        sys.exit("make aarch64: got no qemu-aarch64-static; allowed: Debian or Ubuntu with qemu-user-static")
    folder = ROOT / "build" / "aarch64"
    python = _python(folder)
    there = {"PYTHONPATH": f"{_wheels(folder, python)}:{ROOT}", "XDG_CACHE_HOME": str(folder / "cache")}
    emulated = [qemu, "-L", folder / "root", python]
    files = [ROOT / "tests" / "soro_hardware" / f"test_{name}.py" for name in TESTS]
    # A process that a test starts is not emulated.
    kept = ("-m", "not process and not ros and not slow", "-p", "no:cacheprovider", "--timeout", "3000")
    _call(*emulated, "-m", "pytest", "--quiet", *kept, *files, **there)
    print(
        "The arm at rest [1/m], here and in emulation, which compiles the kernels first:",
        flush=True,
    )
    _call(sys.executable, "-c", MODEL)
    _call(*emulated, "-c", MODEL, **there)


def _python(folder: Path) -> Path:
    """Return Python for arm64, which is unpacked where it is not there."""
    root = folder / "root"
    if not root.exists():
        for name in ("lists/partial", "cache/archives/partial"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        # Of a machine without any package, so that apt-get brings all that Python needs.
        (folder / "status").touch()
        apt = ["apt-get", "-qq"]
        for option in ("APT::Architecture=arm64", "APT::Architectures=arm64", "Debug::NoLocking=1"):
            apt += ["-o", option]
        for key, name in (("State::Lists", "lists"), ("State::status", "status"), ("Cache", "cache")):
            apt += ["-o", f"Dir::{key}={folder / name}"]
        _call(*apt, "update")
        wanted = ("python3", "libstdc++6")
        _call(*apt, "install", "--yes", "--download-only", "--no-install-recommends", *wanted)
        for package in sorted((folder / "cache" / "archives").glob("*.deb")):
            _call("dpkg-deb", "--extract", package, root)
    return (root / "usr" / "bin" / "python3").resolve()


def _wheels(folder: Path, python: Path) -> Path:
    """Return the folder of packages for that Python."""
    site = folder / "site"
    if not site.exists():
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        packages = [*project["dependencies"], *TESTS_NEED]
        packages += [one for extra in EXTRAS for one in project["optional-dependencies"][extra]]
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        pip += ["--only-binary", ":all:", "--python-version", python.name.removeprefix("python")]
        for platform in PLATFORMS:
            pip += ["--platform", platform]
        _call(*pip, "--target", site, *packages)
    return site


def _call(*command: str | Path, **more: str) -> None:
    subprocess.run([str(part) for part in command], check=True, cwd=ROOT, env={**os.environ, **more})


if __name__ == "__main__":
    main()
