"""A ROS domain that no other test, process or worker of this machine uses meanwhile."""

import contextlib
import itertools
import os
from collections.abc import Iterator

from tests.machine_lock import machine_lock

# Domains above 101 collide with Linux's ephemeral ports; 0 is that of whoever uses this machine. Each worker
# goes through a range of its own, so that a domain rests before it is used again: participants that were
# killed linger for some seconds.
FIRST, LAST = 2, 100
_taken = itertools.count()


def _candidates() -> list[int]:
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    every = range(FIRST, LAST)
    mine = every[int(worker) % len(every) :: workers]
    start = next(_taken) % len(mine)
    return [*mine[start:], *mine[:start], *(number for number in every if number not in mine)]


@contextlib.contextmanager
def free_domain() -> Iterator[int]:
    """Hold a free domain, and yield its number; RuntimeError where every one is taken."""
    for number in _candidates():
        lock = machine_lock(f"domain-{number}", waits=False)
        if lock is not None:
            with lock:
                yield number
            return
    raise RuntimeError("no free ROS domain; is a test run left over?")
