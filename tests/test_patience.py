"""What the tests do where the machine stands still."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import STILL_S, StandStill

ROOT = Path(__file__).resolve().parent.parent

# Holds the interpreter, as a machine that stands still does with all of its threads.
STAND_STILL = f"import ctypes; ctypes.PyDLL(None).usleep({round(4e6 * STILL_S)})"

FAILS = """
import pathlib, pytest

@pytest.mark.real_time
def test_it():
    runs = pathlib.Path({runs!r})
    runs.write_text(runs.read_text() + "x")
    {before}
    assert len(runs.read_text()) > {passes_after}
"""


def test_a_stand_still_is_seen():
    with StandStill() as stood:
        exec(STAND_STILL)
    assert stood.longest_s > 2 * STILL_S


@pytest.mark.process
@pytest.mark.parametrize(
    ("before", "passes_after", "runs", "status"),
    [(STAND_STILL, 1, 2, 0), (STAND_STILL, 9, 3, 1), ("pass", 0, 1, 0)],
    ids=["passes again", "fails again and again", "passes at once"],
)
def test_a_test_of_real_time_is_repeated_where_the_machine_stood_still(
    tmp_path, before, passes_after, runs, status
):
    count, file = tmp_path / "runs", tmp_path / "test_it.py"
    count.write_text("")
    file.write_text(FAILS.format(runs=str(count), before=before, passes_after=passes_after))
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-c",
        str(ROOT / "pyproject.toml"),
        "-p",
        "tests.conftest",
    ]
    done = subprocess.run([*command, str(file)], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == status, done.stdout + done.stderr
    assert len(count.read_text()) == runs
