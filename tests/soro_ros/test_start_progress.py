"""The start of a run while kernels are compiled: its lines, and its time limit."""

import fcntl
import itertools

import pytest

from soro_core._jit import LOCK
from soro_core.errors import SoroError
from soro_ros.process import kernels
from soro_ros.run import start_progress
from soro_ros.run.start_progress import StartProgress
from soro_ros.run.supervisor import RunMonitor


@pytest.fixture
def compiling(monkeypatch):
    """Kernels of which a process has one more whenever they are counted, and still compiles."""
    monkeypatch.setattr(kernels, "compiled", itertools.count(5).__next__)
    with LOCK.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def test_the_lines_say_what_is_done(compiling, monkeypatch):
    monkeypatch.setattr(start_progress, "TELL_S", 0.0)
    lines = []
    progress = StartProgress(lines.append)
    progress.tell(1, 4)
    monkeypatch.setattr(kernels, "compiled", lambda: 6)
    progress.tell(2, 4)
    words = "once (some 3 minutes of a free core): 1 done in 0 s, {} of 4 nodes ready"
    assert lines == [f"compiling kernels of the model, {words.format(ready)}" for ready in (1, 2)]


def test_the_time_of_a_start_does_not_run_while_kernels_are_compiled(domain, compiling):
    progress, checks = StartProgress(print), []
    with RunMonitor("arm") as supervisor:
        wait = ("answer", lambda: len(checks) > 5, lambda: checks.append(1))
        supervisor.wait(*wait, 0.1, progress.is_compiling)
        checks.clear()
        with pytest.raises(SoroError, match=r"^no answer within 0 s: see the log$"):
            supervisor.wait(*wait, 0.1, advice=lambda: ": see the log")


def test_a_kernel_that_takes_too_long_is_not_waited_for(compiling, monkeypatch):
    progress = StartProgress(print)
    assert progress.is_compiling()
    monkeypatch.setattr(start_progress, "KERNEL_LIMIT_S", 0.0)
    assert not progress.is_compiling()
    assert kernels.are_compiled_now()


def test_nothing_is_compiled_where_nobody_holds_the_lock(tmp_path, monkeypatch):
    monkeypatch.setattr("soro_core._jit.LOCK", tmp_path / "lock")
    assert not kernels.are_compiled_now()
