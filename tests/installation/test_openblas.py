"""The tests marked `numerics` under three kinds of kernels of OpenBLAS, in processes of their own.

OpenBLAS has kernels for each family of processors, whose results differ in the last digits. What is right
under one of them by luck, such as the exact zero of a pivot, fails under another.
"""

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[2]
# By OPENBLAS_CORETYPE: the name under which OpenBLAS reports its kernels, and what the processor must offer.
# Those of Prescott serve every x86-64 processor; OpenBLAS reports them by an older name.
KINDS = {
    "Haswell": ("Haswell", "avx2"),
    "SkylakeX": ("SkylakeX", "avx512f"),
    "Prescott": ("Katmai", "pni"),
}
ASK = """
import numpy, scipy.linalg, threadpoolctl
print(*{one["architecture"] for one in threadpoolctl.threadpool_info() if one["internal_api"] == "openblas"})
"""


def marked():
    """Files of tests that are marked."""
    files = sorted(file for file in (ROOT / "tests").rglob("test_*.py") if file != Path(__file__).resolve())
    return [file for file in files if "pytest.mark.numerics" in file.read_text()]


@pytest.mark.timeout(900)  # the first may compile kernels
@pytest.mark.parametrize("kind", KINDS)
def test_numbers_hold_under_the_kernels_of(kind):
    name, feature = KINDS[kind]
    if platform.machine() != "x86_64" or not Path("/proc/cpuinfo").exists():
        pytest.skip("OpenBLAS has these kernels on x86-64, and Linux says what the processor offers")
    if not re.search(rf"^flags.*\b({feature})\b", Path("/proc/cpuinfo").read_text(), re.MULTILINE):
        pytest.skip(f"this processor has no {feature}, which the kernels of {kind} use")
    own = subprocess.run([sys.executable, "-c", ASK], capture_output=True, text=True)
    if own.stdout.split() == [name]:
        pytest.skip(f"the tests themselves run under the kernels of {kind}")
    environ = {**os.environ, "OPENBLAS_CORETYPE": kind}
    used = subprocess.run([sys.executable, "-c", ASK], env=environ, capture_output=True, text=True)
    assert used.stdout.split() == [name], used.stderr
    options = [
        "-q",
        "-m",
        "numerics",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
    ]
    command = [sys.executable, "-m", "pytest", *options, *map(str, marked())]
    done = subprocess.run(command, cwd=ROOT, env=environ, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
