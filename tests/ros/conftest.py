"""A ROS domain of its own for every test that starts nodes."""

import fcntl
import itertools
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="the ROS part is not installed on this platform")

# Domains above 101 collide with Linux's ephemeral ports. Each worker goes through a range of its own, so that
# a domain rests before it is used again: participants that were killed linger for some seconds.
FIRST, LAST = 2, 100
_taken = itertools.count()


def _candidates() -> list[int]:
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    mine = range(FIRST + int(worker), LAST, workers)
    start = next(_taken) % len(mine)
    return [*mine[start:], *mine[:start]]


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """A domain that no other test, process or worker uses meanwhile, set in the environment."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
    for number in _candidates():
        lock = (Path(tempfile.gettempdir()) / f"soro-test-domain-{number}.lock").open("w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        monkeypatch.delenv("ROS_LOCALHOST_ONLY", raising=False)
        yield number
        lock.close()
        return
    pytest.fail("no free ROS domain; is a test run left over?")


@pytest.fixture
def alone() -> Iterator[None]:
    """Held by one test at a time, of whatever worker: two real-time runs are more than two cores can do."""
    with (Path(tempfile.gettempdir()) / "soro-test-real-time.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
