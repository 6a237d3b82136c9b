"""What a failed test leaves open fails no other test."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parent.parent

TESTS = """
import gc, socket

class Device:
    def __init__(self):
        self.line, self.itself = socket.socket(), self

def test_that_fails():
    device = Device()
    assert not device

def test_after_it():
    for _ in range(3):
        gc.collect()
"""


def test_an_open_socket_of_a_failed_test_is_collected_with_it(tmp_path):
    file = tmp_path / "test_it.py"
    file.write_text(TESTS)
    options = ["-q", "-c", str(ROOT / "pyproject.toml"), "-p", "tests.conftest", "-p", "no:cacheprovider"]
    command = [sys.executable, "-m", "pytest", *options, str(file)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert "1 failed, 1 passed in" in done.stdout, done.stdout + done.stderr
