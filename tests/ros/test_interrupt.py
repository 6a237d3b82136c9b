"""Ctrl-C at any moment of a start: one clean end, whoever is still importing, compiling or configuring."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer

import soro_ros
from soro_core.scene import load_scene
from soro_ros import cli, kernels, processes, signals
from soro_ros.compose import Run
from tests.ros.running import end, start_run, wait_until

HEAVY = {"typing", "contextlib", "typer", "click", "re", "pathlib", "numpy"}
ENDS = ("ended before control began", "vented; bag closed", "interrupted before anything was st")


@pytest.mark.timeout(120)
@pytest.mark.parametrize("after_s", [0.0, 0.8, 1.5, 2.5, 4.6])
def test_ctrl_c_while_the_nodes_start_is_one_clean_end(domain, tmp_path, after_s):
    process = start_run(tmp_path / "runs")
    # Before the first line of `soro`, Python itself is what a Ctrl-C ends.
    wait_until(lambda: "pydantic_core" in mapped(process.pid), 60, "import of the commands", every_s=0.001)
    time.sleep(after_s)
    status, out, err = end(process, limit_s=60)
    assert status == 130, err
    assert sum(text in err for text in ENDS) == 1, err
    assert "Traceback" not in out + err
    assert "trouble" not in err
    assert "ended with status" not in err


def mapped(pid: int) -> str:
    """Files that a process has mapped, compiled modules among them."""
    return Path(f"/proc/{pid}/maps").read_text()


def test_the_handler_stands_before_anything_else_is_imported():
    """A KeyboardInterrupt in a callback of the import system is printed and forgotten; `soro run` ran on."""
    look = "import sys; sys.path.insert(0, sys.argv[1]); import soro_ros.cli; print(*sys.modules)"
    root = Path(soro_ros.__file__).parents[1]
    command = [sys.executable, "-S", "-c", look, str(root)]
    imported = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert "soro_ros.cli" in imported
    assert HEAVY.isdisjoint(imported)


def test_ctrl_c_until_a_command_begins_ends_at_once(monkeypatch):
    """Whatever is imported or forgotten meanwhile."""
    seen = []
    monkeypatch.setattr(
        cli, "_application", lambda: seen.append(signal.getsignal(signal.SIGINT)) or typer.Typer()
    )
    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(sys, "argv", ["soro", "--help"])
    with pytest.raises((SystemExit, RuntimeError)):
        cli.main()
    assert seen == [cli._leave]
    assert signal.getsignal(signal.SIGINT) is before


def interrupted_compiler(raises: bool) -> None:
    """As numba does with a signal that meets it within a callback of its compiler."""
    with contextlib.suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    if raises:
        raise RuntimeError("no compiled object yet")


@pytest.mark.parametrize("raises", [False, True])
def test_an_interrupt_that_became_an_error_or_was_forgotten_is_the_interrupt(raises):
    seen: list[int] = []
    with pytest.raises(KeyboardInterrupt), signals.raised(seen):
        interrupted_compiler(raises)
    assert seen == [signal.SIGINT]


def python(text: str, folder) -> processes.Child:
    return processes.start("child", [sys.executable, "-c", text], folder)


def test_a_process_is_asked_to_end_until_it_listens(tmp_path):
    # As a node does: for a second it imports and hears nothing.
    late = "import signal, sys, time; time.sleep(1); signal.signal(signal.SIGINT, lambda *_: sys.exit(0))"
    child = python(f"{late}; time.sleep(60)", tmp_path)
    time.sleep(0.3)
    assert processes.stop(child, patience_s=20) == (0, False)
    assert child.log.read_text() == ""


def test_a_process_that_never_listens_is_ended(tmp_path):
    child = python("import time; time.sleep(60)", tmp_path)
    time.sleep(0.2)
    assert processes.stop(child, patience_s=0.5) == (-signal.SIGTERM, True)
    assert child.obituary(forced=True) == "child did not end when it was asked to, and was killed"
    child = python("import time; time.sleep(60)", tmp_path)
    os.kill(child.process.pid, signal.SIGTERM)
    assert child.process.wait(5) == -signal.SIGTERM


@pytest.mark.parametrize("file", ["/dev/full", "/none/summary.json"])
def test_a_file_that_cannot_be_written_is_one_line(monkeypatch, capsys, file):
    class Writing:
        def callback(self):
            return lambda begin: None

        def __call__(self):
            Path(file).write_text("x")

    monkeypatch.setattr(cli, "_application", Writing)
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 1
    said = capsys.readouterr().err
    assert said in (
        "soro: No space left on device\n",
        "soro: /none/summary.json: No such file or directory\n",
    )


@pytest.mark.timeout(120)
def test_ctrl_c_while_kernels_are_compiled_is_one_clean_end(domain, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    process = start_run(tmp_path / "runs")
    for line in process.stderr:
        if "compiles the model's kernels" in line:
            break
    status, out, err = end(process, limit_s=60)
    assert status == 130, err
    assert "ended before control began; bag closed" in err
    assert "ended with status" not in err
    assert "Traceback" not in out + err


@pytest.mark.parametrize(("counts", "told"), [([5, 5, 5], False), ([0, 1, 2], True)])
def test_compiling_is_spoken_of_only_where_kernels_come_new(tmp_path, monkeypatch, counts, told):
    remaining = iter(counts)
    monkeypatch.setattr(kernels, "compiled", lambda: next(remaining))
    said: list[str] = []

    class Patient:
        def wait(self, what, ready, check, limit_s):
            check()
            check()

    run = Run(load_scene("track_circle"), tmp_path, said.append)
    run._ready(Patient(), ["twin"], lambda: False)
    run.end()
    assert sum("compiles" in line for line in said) == told
