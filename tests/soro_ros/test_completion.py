"""What a shell offers after TAB, tried in bash; and what that imports."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

# Completes the words that follow, as bash does after TAB.
SCRIPT = """
eval "$(soro --show-completion)"
complete -p soro
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
_soro_completion soro
echo "${COMPREPLY[@]}"
"""
HEAVY = {"numba", "scipy", "matplotlib", "rclpy", "soro_core.model", "soro_core.loop"}
CHECKING = {"numpy", "pydantic"}


@pytest.fixture
def offered(tmp_path):
    """Return what bash offers for the last of some words."""
    (tmp_path / "bin").mkdir()
    soro = tmp_path / "bin/soro"
    soro.write_text(f"#!{sys.executable}\nfrom soro_ros.cli import main\n\nmain()\n")  # as pip makes it
    soro.chmod(0o755)
    root = str(Path(__file__).parents[2])
    surroundings = {**os.environ, "PATH": f"{soro.parent}:{os.environ['PATH']}", "PYTHONPATH": root}

    def complete(*words):
        command = ["bash", "--norc", "-c", SCRIPT, "bash", "soro", *words]
        done = subprocess.run(
            command, capture_output=True, text=True, check=True, cwd=tmp_path, env=surroundings
        )
        assert done.stderr == ""
        registered, found = done.stdout.splitlines()
        assert "-F _soro_completion soro" in registered
        return found.split()

    return complete


@pytest.mark.process
@pytest.mark.parametrize(
    ("words", "found"),
    [
        (("re",), ["report", "reset", "replay", "reach"]),
        (("run", "track_c"), ["track_circle"]),
        (("reach", "tue_th"), ["tue_three_bellow"]),
        (("doctor", "emulated_canopen_4"), ["emulated_canopen_4ch"]),
        (("run", "x", "--set", "twin.payload_k"), ["twin.payload_kg="]),
        (("view", "ru"), ["runs/later", "runs/sooner"]),
    ],
)
def test_bash_offers_commands_names_keys_and_runs(offered, tmp_path, words, found):
    for k, name in enumerate(("sooner", "later")):
        (tmp_path / "runs" / name).mkdir(parents=True)
        os.utime(tmp_path / "runs" / name, (k, k))
    assert offered(*words) == found


@pytest.mark.process
@pytest.mark.parametrize(
    ("words", "forbidden"),
    [("soro ru", HEAVY | CHECKING), ("soro run tr", HEAVY), ("soro x --set tw", HEAVY)],
)
def test_a_completion_imports_nothing_heavy(words, forbidden):
    asked = {
        "_SORO_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
    }
    command = [sys.executable, "-X", "importtime", "-m", "soro_ros.cli"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **asked})
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "typer" in imported
    assert forbidden.isdisjoint(imported)
