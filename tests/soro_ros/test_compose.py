"""Starting a scene's processes, with processes that wait in place of the nodes."""

import importlib
import signal
import sys

import pytest

from soro_core.errors import SoroError
from soro_lab.scene import load_scene
from soro_ros.process import kernels
from soro_ros.run import loop_nodes, processes, run_processes
from soro_ros.run.compose import Run

# As a node: it ends at SIGINT, which is ignored until it has imported everything.
WAITS = [
    sys.executable,
    "-S",
    "-c",
    "import signal; signal.signal(signal.SIGINT, signal.SIG_DFL); signal.pause()",
]
REAL = {"valves": "real", "device": "/dev/x", "arm": "real"}


class Ready:
    """A supervisor whose nodes are all active; each wait checks twice."""

    commanded, controlled_s = True, 1.0

    def __init__(self):
        self.asked = []

    def active(self, name):
        return True

    def values(self, name):
        return {}

    def wait(self, what, ready, check, limit_s, *of):
        check()
        check()
        if not ready():
            raise SoroError(f"no {what}")

    def check_alone(self, names):
        self.asked.append(list(names))

    def listen_to(self, name, pid):
        pass

    def check_clock(self):
        pass

    def look(self):
        pass


class Meeting(Ready):
    """A supervisor that receives the status of another run's recorder."""

    def check_alone(self, names):
        super().check_alone(names)
        raise SoroError("another /track_circle/recorder")


@pytest.fixture
def start(tmp_path, monkeypatch):
    """Make a run of the shipped scene with changed keys; returns it and the lines that it reports."""
    monkeypatch.setattr(processes, "node_command", lambda *of: WAITS)
    runs = []

    def made(changes, interrupted=()):
        lines = []
        runs.append(Run(load_scene("track_circle", changes), tmp_path, lines.append, interrupted))
        return runs[-1], lines

    yield made
    for run in runs:
        run.end()


def test_a_run_that_meets_another_ends_before_it_takes_its_nodes_for_its_own(start):
    run, _ = start({"platform": ""})
    supervisor = Meeting()
    with pytest.raises(SoroError, match="another /track_circle/recorder"):
        run.start(supervisor)
    assert supervisor.asked == [["recorder"]]
    assert run.processes.nodes == []


@pytest.mark.process
def test_the_nodes_of_a_run_end_if_their_start_fails(start, monkeypatch):
    configs = []
    monkeypatch.setattr(processes, "node_command", lambda name, config, *of: configs.append(config) or WAITS)
    run, _ = start({"platform": ""})
    run.start(Ready())
    assert [config.end_on_failed_start for config in configs] == [True] * 4


@pytest.mark.process
@pytest.mark.parametrize("wanted", [True, False])
def test_markers_start_with_a_run_that_wants_them(start, wanted):
    run, _ = start({"platform": "", "markers": wanted})
    run.start(Ready())
    assert ("markers" in run.processes.nodes) == wanted


@pytest.mark.process
@pytest.mark.parametrize(("compiled", "lines"), [(lambda: 5, 0), (iter(range(100)).__next__, 1)])
def test_new_kernels_are_reported_once(start, monkeypatch, compiled, lines):
    run, reported = start({"platform": ""})
    monkeypatch.setattr(kernels, "compiled", compiled)
    monkeypatch.setattr(kernels, "are_compiled_now", lambda: True)
    run.start(Ready())
    assert sum("compiling kernels" in line for line in reported) == lines


@pytest.mark.process
def test_without_a_pose_of_the_real_arm_control_does_not_begin(start):
    run, _ = start(REAL)
    with pytest.raises(SoroError, match="no pose of the arm on sensors/pose0"):
        run.start(Ready())
    run.end()
    assert run.outcome() == "ended before control began"


@pytest.mark.process
@pytest.mark.parametrize("at", ["the start", "the valves", "the nodes"])
def test_a_signal_ends_the_start_before_the_next_process(start, monkeypatch, at):
    interrupted = [signal.SIGINT] if at == "the start" else []
    run, reported = start({}, interrupted)

    class Interrupting(Ready):
        def wait(self, *of):
            interrupted.append(signal.SIGINT)  # seen after this wait at the latest

    started = []

    def process(name, command, folder, priority=0, pipe=None):
        started.append(name)
        if at == "the valves":
            interrupted.append(signal.SIGINT)
        return silent if name == "valves" and at == "the valves" else waiting(name, folder)

    real = processes.start

    def waiting(name, folder):
        child = real(name, WAITS, folder)
        if name == "valves":
            child.log.write_text("ready: somewhere")
        return child

    silent = waiting("silent", run.folder)
    monkeypatch.setattr(processes, "start", process)
    try:
        with pytest.raises(KeyboardInterrupt):
            run.start(Interrupting())
    finally:
        processes.stop(silent, 5.0)
    expected = {"the start": [], "the valves": ["valves"], "the nodes": ["valves", "recorder"]}
    assert started == expected[at]
    assert len(reported) == len(started)
    assert run.outcome().startswith("ended before control began")


@pytest.mark.process
def test_a_scene_of_emulated_valves_starts_them_first_and_the_driver_last(start, monkeypatch):
    run, _ = start({"mode": "real_time"})
    real, started = processes.start, []

    def process(name, command, folder, priority=0, pipe=None):
        started.append(name)
        child = real(name, WAITS, folder)
        if name == "valves":
            child.log.write_text("ready: somewhere")
        return child

    monkeypatch.setattr(processes, "start", process)
    run.start(Ready())
    assert started == ["valves", "recorder", "twin", "estimator", "controller", "regulator"]
    assert set(started) <= set(run_processes.END_ORDER)


@pytest.mark.process
def test_a_twin_that_drives_the_chambers_ends_first(start, monkeypatch):
    """Its commands end on purpose then, and are not lost."""
    run, _ = start({"platform": ""})
    real, ended = processes.stop, []

    def stop(child, limit_s):
        ended.append(child.name)
        return real(child, limit_s)

    monkeypatch.setattr(processes, "stop", stop)
    run.start(Ready())
    run.end()
    assert ended == ["twin", "controller", "estimator", "recorder"]


class Saying(Ready):
    """A supervisor that hears errors and silences of nodes."""

    def __init__(self, errors=(), silent=()):
        super().__init__()
        self.errors, self.silent = errors, silent

    def call(self, service):
        return ""

    def error(self, name):
        return f"{name}: disk full" if name in self.errors else ""

    def silence(self, name):
        return f"{name}: no message" if name in self.silent else ""

    def check(self, names, spares_requested):
        self.spares_requested = spares_requested
        if found := "".join(map(self.error, names)):
            raise SoroError(found)

    def check_silence(self, names):
        if found := "".join(map(self.silence, names)):
            raise SoroError(found)


@pytest.fixture
def started(start):
    """A run with an observer of each kind, in control, and the lines that it reports."""
    run, lines = start({"platform": "", "markers": True, "mode": "lockstep"})
    run.start(Ready())
    run.begin(Saying())
    return run, lines


@pytest.mark.process
def test_the_failure_of_an_observer_is_a_warning_and_that_of_the_recorder_no_judgement(started):
    run, lines = started
    for _ in range(2):
        run.check_nodes(Saying(errors=["markers"], silent=["recorder"]), 1.0)
    assert run.warnings == {"markers": "markers: disk full", "recorder": "recorder: no message"}
    assert run.recording_failure == ""
    run.check_nodes(Saying(errors=["recorder"]), 1.0)
    assert run.recording_failure == "recorder: disk full"
    assert sum("the arm goes on" in line for line in lines) == 3


@pytest.mark.process
def test_an_observer_that_has_ended_is_reported_once_and_ends_nothing(started):
    run, lines = started
    run.processes.children["recorder"].process.kill()
    run.processes.children["recorder"].process.wait()
    for _ in range(2):
        run.check_nodes(Saying(silent=["recorder"]), 1.0)
    assert sum("status -9" in line for line in lines) == 1
    assert "recorder" not in run.end()
    assert "status -9" in run.recording_failure
    assert "soro bag repair" in run.outcome() or not run.bag.exists()


@pytest.mark.process
@pytest.mark.parametrize("name", ["twin", "estimator", "controller"])
@pytest.mark.parametrize("how", ["errors", "silent"])
def test_the_failure_of_a_node_of_the_loop_ends_the_run(started, name, how):
    with pytest.raises(SoroError, match=name):
        started[0].check_nodes(Saying(**{how: [name]}), 1.0)


@pytest.mark.process
def test_an_excitation_ends_with_its_recording(start):
    run, _ = start({"platform": "", "mode": "lockstep"})
    run._loop = loop_nodes.excitation_loop(run.scene)
    run.start(Ready())
    run.begin(Saying())
    saying = Saying(errors=["recorder"])
    with pytest.raises(SoroError, match="recorder"):
        run.check_nodes(saying, 1.0)
    assert not saying.spares_requested  # a vent, too, ends what it records


def test_the_observers_of_a_run_are_those_of_the_nodes():
    for name in {*run_processes.END_ORDER} - {"valves"}:
        node = importlib.import_module(f"soro_ros.nodes.{name}")
        (found,) = {one.is_observer for one in vars(node).values() if getattr(one, "node_name", "") == name}
        assert found == (name in loop_nodes.OBSERVERS)


@pytest.mark.process
def test_a_run_in_real_time_that_stood_still_ends(start):
    run, _ = start({"platform": "", "mode": "real_time"})
    run.start(Ready())
    run.begin(Saying())
    run.check_nodes(Saying(), 1.0)
    (pulse,) = run.processes.pulses.values()
    pulse.stood_still_s = 1.2
    with pytest.raises(SoroError, match=r"stood still for 1\.2 s"):
        run.check_nodes(Saying(), 1.0)
