"""Processes that a fork server forks for a run are as those that the run starts itself."""

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from soro_core.errors import SoroError
from soro_ros.run import processes
from soro_ros.run.forks import ForkServer
from soro_ros.run.processes import Child
from tests.patience import LIMIT_S
from tests.soro_ros.running import alive, wait_until

pytestmark = [pytest.mark.process, pytest.mark.ros]


@pytest.fixture(scope="module")
def forks(tmp_path_factory):
    with ForkServer(tmp_path_factory.mktemp("run")) as server:
        wait_until(server.has_answered, "its imports")
        yield server


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "tests.soro_ros.forked", *words]


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (("nothing",), 0, ""),
        (("exit", "2"), 2, ""),
        (("fail",), 1, "ValueError: no such thing"),
    ],
)
def test_it_ends_as_a_started_one(forks, tmp_path, words, status, said):
    for start in (forks.start, processes.start):
        child = start("child", command(*words), tmp_path)
        assert child.process.wait(LIMIT_S) == child.process.poll() == status
        first, *rest = child.log.read_text().splitlines()
        pid = child.process.pid
        assert first == f"{pid} {os.getpid()} {pid}  {list(words)}"  # its parent is this process
        assert said in "".join(rest[-1:])


def test_its_signals_and_its_name_are_its_own(forks, tmp_path):
    child = forks.start("child", command("wait"), tmp_path)
    wait_until(lambda: "waits" in child.log.read_text(), "its start")
    line = Path(f"/proc/{child.process.pid}/cmdline").read_bytes().decode().rstrip("\0").split("\0")
    assert line == command("wait")
    with pytest.raises(subprocess.TimeoutExpired):
        child.process.wait(0.01)
    child.process.send_signal(signal.SIGINT)  # nobody handles it
    assert child.process.poll() is None
    child.process.terminate()
    assert child.process.wait(LIMIT_S) == 7
    killed = forks.start("child", command("wait"), tmp_path)
    killed.process.send_signal(signal.SIGKILL)
    assert killed.process.wait(LIMIT_S) == -signal.SIGKILL
    assert "killed" in killed.end_report()


def test_what_else_loses_its_parent_is_not_adopted(forks, tmp_path):
    """The second process of a driver that was killed; nobody here would wait for it."""
    forks.start("child", command("nothing"), tmp_path).process.wait(LIMIT_S)
    code = "import os; os.fork() and print('forked', flush=True); os.read(0, 1); print(os.getppid())"
    ours, theirs = os.pipe()
    parent = subprocess.Popen([sys.executable, "-c", code], stdin=ours, stdout=subprocess.PIPE, text=True)
    assert parent.stdout.readline() == "forked\n"
    parent.kill()
    parent.wait()
    os.write(theirs, b"x")
    assert int(parent.stdout.readline()) not in (os.getpid(), parent.pid)
    parent.stdout.close()
    os.close(ours)
    os.close(theirs)


def test_only_who_listens_has_the_pipe(forks, tmp_path):
    ours, theirs = os.pipe()
    child = forks.start("child", command("read"), tmp_path, pipe=ours)
    os.write(theirs, b"sign")
    assert child.process.wait(LIMIT_S) == 0
    assert child.log.read_text().splitlines()[-1] == "sign"
    os.close(ours)
    with pytest.raises(BrokenPipeError):  # the server keeps none
        os.write(theirs, b"sign")
    os.close(theirs)


_RUN = """
import pathlib, sys, time
from soro_ros.run.forks import ForkServer
folder = pathlib.Path(sys.argv[1])
server = ForkServer(folder)
while not server.has_answered():
    time.sleep(0.01)
command = [sys.executable, "-m", "tests.soro_ros.forked", "wait"]
for k in range(2):
    print(server.start(f"child{k}", command, folder).process.pid)
print(server._child.process.pid, flush=True)
time.sleep(100)
"""


def test_all_end_with_the_program_that_runs_the_arm(tmp_path):
    program = subprocess.Popen([sys.executable, "-c", _RUN, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    pids = [int(program.stdout.readline()) for _ in range(3)]
    for k in range(2):
        wait_until(lambda k=k: "waits" in (tmp_path / f"log/child{k}.log").read_text(), "its start")
    program.kill()
    program.communicate()
    wait_until(lambda: not any(map(alive, pids)), "their end")


def test_a_program_that_ends_at_once_leaves_no_word_of_its_server(tmp_path):
    server = ForkServer(tmp_path)
    wait_until(lambda: select.select([server._socket], [], [], 0.1)[0], "its imports")
    server._socket.close()  # without having read the answer
    assert server._child.process.wait(LIMIT_S) == 0
    assert server._child.log.read_text() == ""


def test_a_server_that_has_ended_is_one_line(tmp_path):
    with ForkServer(tmp_path) as server:
        wait_until(server.has_answered, "its imports")
        child: Child = server.start("child", command("wait"), tmp_path)
        server._child.process.kill()
        with pytest.raises(SoroError, match=r"^fork_server ended with status -9: killed"):
            wait_until(server.has_answered, "its end")
        server.warm(tmp_path)
        with pytest.raises(SoroError, match=r"^fork_server ended with status -9: killed"):
            server.start("late", command("nothing"), tmp_path)
        assert child.process.poll() is None or child.process.returncode in (7, -signal.SIGTERM)
        child.process.send_signal(signal.SIGKILL)
        child.process.wait(LIMIT_S)
