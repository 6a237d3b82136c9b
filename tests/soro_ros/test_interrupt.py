"""Ctrl-C at any moment of a start: one clean end, whoever is still importing, compiling or configuring."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import typer

import soro_ros
from soro_hardware import signals
from soro_ros import cli
from soro_ros.nodes.regulator import RegulatorNode
from soro_ros.process import command_line, node_process
from soro_ros.run import processes
from tests.patience import LIMIT_S, patient_platform
from tests.soro_ros.running import end, only_run, start_run, summary, wait_until

HEAVY = {"typing", "contextlib", "typer", "click", "re", "pathlib", "numpy"}


def started(name: str) -> Callable[[Path], bool]:
    """Whether a process of a run has been started."""
    return lambda runs: any(runs.glob(f"*/log/{name}.log"))


# What has just happened when Ctrl-C comes: by events, and not by times, whatever the speed of the machine.
MOMENTS = {
    "commands are imported": lambda runs: True,
    "the valves start": started("valves"),
    "the nodes start": started("controller"),
    "the driver starts": started("regulator"),
}


@pytest.mark.process
@pytest.mark.parametrize("moment", MOMENTS)
def test_ctrl_c_while_the_nodes_start_is_one_clean_end(domain, tmp_path, moment):
    runs = tmp_path / "runs"
    process = start_run(runs, f"platform={patient_platform(tmp_path)}", popen=subprocess.Popen)
    try:
        # Before the first line of `soro`, Python itself is what a Ctrl-C ends.
        wait_until(lambda: "pydantic_core" in mapped(process.pid), "import of the commands", every_s=0.001)
        wait_until(lambda: MOMENTS[moment](runs), moment, every_s=0.001)
    finally:
        status, out, err = end(process, limit_s=120)
    assert status == 130, err
    assert_clean(out + err, runs)


def assert_clean(output: str, runs: Path) -> None:
    """No process has failed; one that still imports when its patience is over may have been killed."""
    assert "Traceback" not in output
    assert not re.search(r"status -?\d", output), output
    if runs.exists():  # else nothing was started
        assert summary(only_run(runs))["verdict"] == "vented"  # control had not begun
        for file in runs.glob("*/log/*.log"):
            assert "Traceback" not in file.read_text(errors="replace"), file


def mapped(pid: int) -> str:
    """Files that a process has mapped, compiled modules among them."""
    return Path(f"/proc/{pid}/maps").read_text()


@pytest.mark.process
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
        cli, "application", lambda *_: seen.append(signal.getsignal(signal.SIGINT)) or typer.Typer()
    )
    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(sys, "argv", ["soro", "--help"])
    with pytest.raises((SystemExit, RuntimeError)):
        cli.main()
    assert seen == [cli.leave]
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


HALF_MADE = """
def make(interrupted):
    interrupted()
    made.append("whole")
"""


def test_an_interrupt_waits_until_llvm_has_returned():
    """Half-made objects of llvmlite fail as they are deleted: a traceback, and once a crash."""
    made: list[str] = []
    llvm = {"__name__": "llvmlite.binding.passes", "made": made}
    exec(HALF_MADE, llvm)

    def work():
        llvm["make"](lambda: signal.raise_signal(signal.SIGINT))
        time.sleep(LIMIT_S)
        made.append("too late")

    with pytest.raises(KeyboardInterrupt), signals.raised(seen := []):
        work()
    assert (seen, made) == ([signal.SIGINT], ["whole"])
    assert signal.getitimer(signal.ITIMER_REAL) == (0, 0)


def test_a_signal_that_comes_as_the_work_ends_leaves_no_handler(monkeypatch):
    """With one it would interrupt what follows: the node's safe end."""
    restore, coming = signal.signal, [signal.SIGTERM, signal.SIGTERM]

    def restore_late(number, handler):
        if coming:
            signal.raise_signal(coming.pop())
        return restore(number, handler)

    with signals.noted() as noted:
        before = [signal.getsignal(number) for number in signals.SIGNALS]
        seen: list[int] = []
        with signals.raised(seen):
            monkeypatch.setattr(signals.signal, "signal", restore_late)
        monkeypatch.undo()
        assert [signal.getsignal(number) for number in signals.SIGNALS] == before
    assert len(seen + noted) == 2


def test_a_signal_that_comes_as_the_work_begins_leaves_no_handler(monkeypatch):
    install, coming = signal.signal, [signal.SIGTERM]

    def install_late(number, handler):
        previous = install(number, handler)
        if coming and number == signal.SIGTERM:
            signal.raise_signal(coming.pop())
        return previous

    with signals.noted():
        before = [signal.getsignal(number) for number in signals.SIGNALS]
        monkeypatch.setattr(signals.signal, "signal", install_late)
        with pytest.raises(KeyboardInterrupt), signals.raised(seen := []):
            pass
        monkeypatch.undo()
        assert [signal.getsignal(number) for number in signals.SIGNALS] == before
    assert seen == [signal.SIGTERM]


INTERRUPTED_IN_TEXT = """
import signal
from soro_hardware import signals
seen = []
try:
    with signals.raised(seen):
        exec("signal.raise_signal(signal.SIGINT)")
except KeyboardInterrupt:
    raise SystemExit(len(seen) + 2)
"""


@pytest.mark.process
def test_an_interrupt_within_executed_text_leaves_the_exit_status(tmp_path):
    """Python remembers a KeyboardInterrupt that leaves such text, and `python -m` then ends with SIGINT."""
    (tmp_path / "interrupted.py").write_text(INTERRUPTED_IN_TEXT)
    root = Path(soro_ros.__file__).parents[1]
    process = subprocess.run(
        [sys.executable, "-m", "interrupted"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(root)},
        check=False,
    )
    assert process.returncode == 3


def python(text: str, folder) -> processes.Child:
    return processes.start("child", [sys.executable, "-c", text], folder)


@pytest.mark.process
def test_a_process_is_asked_to_end_until_it_listens(tmp_path):
    # As a node does: for a second it imports and hears nothing.
    late = "import signal, sys, time; time.sleep(1); signal.signal(signal.SIGINT, lambda *_: sys.exit(0))"
    child = python(f"{late}; time.sleep(60)", tmp_path)
    time.sleep(0.3)
    assert processes.stop(child, limit_s=20) == (0, False)
    assert child.log.read_text() == ""


@pytest.mark.process
def test_a_process_that_never_listens_is_ended(tmp_path):
    child = python("import time; time.sleep(60)", tmp_path)
    time.sleep(0.2)
    assert processes.stop(child, limit_s=0.5) == (-signal.SIGTERM, True)
    assert child.end_report(forced=True) == "child did not end when it was asked to, and was killed"
    child = python("import time; time.sleep(60)", tmp_path)
    os.kill(child.process.pid, signal.SIGTERM)
    assert child.process.wait(LIMIT_S) == -signal.SIGTERM


@pytest.mark.parametrize("file", ["/dev/full", "/none/summary.json"])
def test_a_file_that_cannot_be_written_is_one_line(monkeypatch, capsys, file):
    class Writing:
        def __init__(self, *_):
            """Leave the signals as they are."""

        def __call__(self):
            Path(file).write_text("x")

    monkeypatch.setattr(cli, "application", Writing)
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 1
    said = capsys.readouterr().err
    assert said in (
        "soro: No space left on device\n",
        "soro: /none/summary.json: No such file or directory\n",
    )


@pytest.mark.process
def test_ctrl_c_while_kernels_are_compiled_is_one_clean_end(domain, tmp_path, monkeypatch):
    cache = tmp_path / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    process = start_run(tmp_path / "runs", f"platform={patient_platform(tmp_path)}")
    too_late = threading.Timer(120, process.kill)
    too_late.start()
    try:
        told = next((line for line in process.stderr if "compiling" in line), "")
    finally:
        too_late.cancel()
        status, out, err = end(process)
    assert re.fullmatch(
        r"compiling kernels of the model, once \(.*\): \d+ done in \d+ s, \d of 4 nodes ready\n", told
    )
    assert any(cache.rglob("*.nbc"))
    assert status == 130, err
    assert_clean(out + err, tmp_path / "runs")


@pytest.mark.process
def test_an_end_that_fails_after_ctrl_c_is_reported_and_goes_on(domain, capfd):
    """The error of a callback is an interrupt while the node starts only."""
    destroyed, stopping = [], []

    class Full(RegulatorNode):
        def __init__(self):
            super().__init__()
            self.create_timer(0.01, lambda: stopping.append(signal.SIGINT))

        def teardown(self):
            raise OSError("disk full")

        def destroy_node(self):
            destroyed.append(self.failure)
            super().destroy_node()

    program = command_line.of_node(Full.node_name, Full.config_model)
    node_process.run_until_end([Full], program, ["--ros-args", "-p", "autostart:=false"], stopping)
    assert ["disk full" in str(failure) for failure in destroyed] == [True]
    assert "disk full" in capfd.readouterr().err
