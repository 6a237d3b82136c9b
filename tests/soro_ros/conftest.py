"""A ROS domain of its own for every test that starts nodes."""

import contextlib
import functools
import gc
import importlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import pytest

from tests.machine_lock import machine_lock
from tests.ros_domain import free_domain

pytest.importorskip("rclpy", reason="the ROS part is not installed on this platform")

import rclpy
from rclpy.node import Node

from soro_hardware import timing
from soro_ros import cli
from soro_ros.host import middleware
from soro_ros.process import node_process


class Ended(NamedTuple):
    """How a program ended."""

    status: int
    out: str
    err: str


@contextlib.contextmanager
def _nodes_destroyed(patch: pytest.MonkeyPatch) -> Iterator[None]:
    """Destroy the nodes that a test makes in this process and leaves.

    They stay in their domain after `rclpy.shutdown`, until they are collected, and meet the next test there.
    """
    made, init = [], Node.__init__

    @functools.wraps(init)
    def noted(node: Node, *arguments: object, **options: object) -> None:
        init(node, *arguments, **options)
        made.append(node)

    patch.setattr(Node, "__init__", noted)
    try:
        yield
    finally:
        for node in made:
            node.destroy_node()


@contextlib.contextmanager
def _timing_restored() -> Iterator[None]:
    """Undo what a node does for its punctuality: the next test would run at a real-time priority."""
    interval = sys.getswitchinterval()
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        gc.unfreeze()
        if os.sched_getscheduler(0) != os.SCHED_OTHER:
            timing.prioritise(0)


@contextlib.contextmanager
def own_domain(state: Path) -> Iterator[int]:
    """A domain that no other test, process or worker uses meanwhile, set in the environment.

    Parameters
    ----------
    state : Path
        Folder for what nodes leave for those that come after them.
    """
    with (
        free_domain() as number,
        pytest.MonkeyPatch.context() as patch,
        _nodes_destroyed(patch),
        _timing_restored(),
    ):
        # The middleware as soro sets it by default, also for nodes of the tests themselves.
        for name in middleware.CHOICES:
            patch.delenv(name, raising=False)
        chosen = {"XDG_STATE_HOME": str(state), "ROS_DOMAIN_ID": str(number), **middleware.settings({})}
        for name, value in chosen.items():
            patch.setenv(name, value)
        yield number


@pytest.fixture
def domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """A domain of the test's own."""
    with own_domain(tmp_path_factory.mktemp("state")) as number:
        yield number


@pytest.fixture
def node(domain: int) -> Iterator[Node]:
    """A node of a command."""
    middleware.init()
    node = Node("command")
    yield node
    node.destroy_node()
    rclpy.shutdown()


@pytest.fixture
def alone() -> Iterator[None]:
    """Held by one test at a time, of whatever worker: two real-time runs are more than two cores can do."""
    # Without its file they run side by side, and may be late.
    with machine_lock("real-time", waits=True) or contextlib.nullcontext():
        yield


@pytest.fixture
def soro(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., Ended]:
    """Run the command `soro` with some arguments in this process, which saves its start."""

    def run(*arguments: str) -> Ended:
        capfd.readouterr()
        monkeypatch.setattr(sys, "argv", ["soro", *arguments])
        monkeypatch.setenv("COLUMNS", "160")
        with pytest.raises(SystemExit) as end:
            cli.main()
        return Ended(int(end.value.code or 0), *capfd.readouterr())

    return run


@pytest.fixture
def node_main(
    domain: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., Ended]:
    """Run the process of a node in this one until it ends by itself, which saves its start.

    A node whose start fails ends, as in `soro run`.
    """
    # Else the alarm that ends a process that hangs when it leaves would end this one.
    alarm = SimpleNamespace(signal=lambda *_: None, alarm=lambda _: None, SIGALRM=None, SIG_DFL=None)
    monkeypatch.setattr(node_process, "signal", alarm)

    def run(node: str | Callable[[], None], *arguments: str) -> Ended:
        capfd.readouterr()
        main = node if callable(node) else importlib.import_module(f"soro_ros.nodes.{node}").main
        ends = () if "--help" in arguments else ("--ros-args", "-p", "end_on_failed_start:=true")
        monkeypatch.setattr(sys, "argv", ["node", *arguments, *ends])
        with pytest.raises(SystemExit) as end:
            main()
        return Ended(int(end.value.code or 0), *capfd.readouterr())

    return run
