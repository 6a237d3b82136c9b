"""Ctrl-C at any moment of a start: one clean end, whoever is still importing, compiling or configuring."""

import contextlib
import os
import signal
import sys
import time

import pytest

from soro_core.scene import load_scene
from soro_ros import kernels, processes, signals
from soro_ros.compose import Run
from tests.ros.running import end, start_run

ENDS = ("ended before the valves were opened", "vented; bag closed", "interrupted before anything was st")


@pytest.mark.timeout(120)
@pytest.mark.parametrize("after_s", [0.3, 0.8, 1.5, 2.5, 4.6])
def test_ctrl_c_while_the_nodes_start_is_one_clean_end(domain, tmp_path, after_s):
    process = start_run(tmp_path / "runs")
    time.sleep(after_s)
    status, out, err = end(process, limit_s=60)
    assert status == 130, err
    assert sum(text in err for text in ENDS) == 1, err
    assert "Traceback" not in out + err
    assert "trouble" not in err
    assert "ended with status" not in err


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
    assert processes.stop(child, patience_s=20) == 0
    assert child.log.read_text() == ""


def test_a_process_that_never_listens_is_ended(tmp_path):
    child = python("import time; time.sleep(60)", tmp_path)
    time.sleep(0.2)
    assert processes.stop(child, patience_s=0.5) == -signal.SIGTERM
    child = python("import time; time.sleep(60)", tmp_path)
    os.kill(child.process.pid, signal.SIGTERM)
    assert child.process.wait(5) == -signal.SIGTERM


@pytest.mark.timeout(120)
def test_ctrl_c_while_kernels_are_compiled_is_one_clean_end(domain, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    process = start_run(tmp_path / "runs")
    for line in process.stderr:
        if "compiles the model's kernels" in line:
            break
    status, out, err = end(process, limit_s=60)
    assert status == 130, err
    assert "ended before the valves were opened; bag closed" in err
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
