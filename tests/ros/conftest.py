"""A ROS domain of its own for every test that starts nodes."""

import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="the ROS part is not installed on this platform")

# Domains above 101 collide with Linux's ephemeral ports.
DOMAINS = range(20, 100)


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A domain that no other test, process or worker uses meanwhile, set in the environment."""
    for number in DOMAINS:
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
    pytest.fail(f"no free ROS domain among {DOMAINS}; is a test run left over? ({os.getpid()})")
