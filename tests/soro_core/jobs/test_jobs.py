"""Jobs: the same results by every executor, lost workers, interrupts, and what cannot be sent."""

import os
import threading
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

import pytest

from soro_core.errors import ConfigError, SoroError
from soro_core.jobs import Here, Processes, Threads, executor_of, map_jobs
from soro_core.jobs.executors import LostWorkerError
from tests.patience import LIMIT_S


def square(x):
    return x * x


def root(x):
    if x < 0:
        raise ConfigError("job", "x", x, "0 or more")
    return x**0.5


def is_first(folder, x):
    """Whether nobody has asked for this job before."""
    try:
        (Path(folder) / f"begun{x}").touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def lost_once(folder, x):
    """End the process at the third job, once."""
    if x == 3 and is_first(folder, x):
        os._exit(1)
    return square(x)


def ends(x):
    os._exit(1)


def ends_beside(folder, x):
    """End the process at job 0, at first while its neighbour, which has begun, waits for its own end."""
    first = is_first(folder, x)
    if x == 1:
        if first:
            (Path(folder) / "pipe").open("w").close()
            threading.Event().wait(LIMIT_S)
        return x
    if first:
        (Path(folder) / "pipe").open().read()
    os._exit(1)


@pytest.fixture(scope="module")
def processes():
    with Processes(2) as executor:
        yield executor


@pytest.fixture(params=["here", "threads", "processes"])
def executor(request, processes):
    with Here() if request.param == "here" else Threads(2) as own:
        yield processes if request.param == "processes" else own


def test_results_come_in_order_from_every_executor(executor):
    assert list(map_jobs(square, iter(range(20)), executor)) == [x * x for x in range(20)]
    assert sorted(map_jobs(square, range(20), executor, in_order=False)) == [x * x for x in range(20)]


def test_the_first_error_is_that_of_the_first_item(executor):
    found = map_jobs(root, [4.0, -1.0, 9.0, -2.0], executor)
    assert next(found) == 2.0
    with pytest.raises(ConfigError, match=r"got -1\.0; allowed: 0 or more") as error:
        next(found)
    assert error.value.key == "x"


def test_a_stop_keeps_what_is_done(executor):
    asked = []

    def stop():
        asked.append(None)
        return len(asked) > 7

    found = list(map_jobs(square, range(1000), executor, stop=stop))
    assert 3 <= len(found) < 20
    assert found == [x * x for x in range(len(found))]


def test_the_work_of_a_lost_process_is_done_again(tmp_path):
    with Processes(2) as executor:
        found = list(map_jobs(partial(lost_once, tmp_path), range(8), executor))
    assert (tmp_path / "begun3").exists()
    assert found == [x * x for x in range(8)]


def test_a_job_that_ends_every_process_is_named():
    with Processes(1) as executor, pytest.raises(SoroError, match="a worker process ended 3 times at job 0"):
        list(map_jobs(ends, [5], executor))


@pytest.mark.parametrize("jobs", [[0, 1], [1, 0]])
def test_the_neighbour_of_a_job_that_ends_processes_is_done(tmp_path, jobs):
    done = []
    os.mkfifo(tmp_path / "pipe")
    with Processes(2) as executor, pytest.raises(SoroError, match=f"3 times at job {jobs.index(0)}"):
        done.extend(map_jobs(partial(ends_beside, tmp_path), jobs, executor, False))
    assert done == [1]


def test_processes_that_cannot_begin_are_named(monkeypatch):
    def broken(pool, function, *arguments):
        raise BrokenProcessPool

    monkeypatch.setattr(ProcessPoolExecutor, "submit", broken)
    with pytest.raises(LostWorkerError, match="worker processes end as they begin"):
        Processes(2).submit(square, 2).result(timeout=1.0)


def test_what_cannot_be_sent_is_one_line(processes):
    with pytest.raises(SoroError, match="a job cannot be sent to another process") as error:
        list(map_jobs(lambda x: x, [1], processes))
    assert "\n" not in str(error.value)


def test_an_interrupt_waits_for_no_job_that_has_not_begun():
    begun, event = [], threading.Event()

    def work(x):
        begun.append(x)
        event.wait(5.0)

    def interrupt():
        if begun:
            event.set()
            raise KeyboardInterrupt
        return False

    with Threads(2) as executor, pytest.raises(KeyboardInterrupt):
        list(map_jobs(work, range(1000), executor, stop=interrupt))
    assert len(begun) <= 4


def test_workers_have_one_thread_of_linear_algebra(processes, monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    assert list(map_jobs(os.getenv, ["OPENBLAS_NUM_THREADS"], processes)) == ["1"]
    assert "OPENBLAS_NUM_THREADS" not in os.environ


def test_jobs_or_a_cluster():
    with pytest.raises(ConfigError, match="either --jobs or --dask"):
        executor_of(2, "tcp://127.0.0.1:1")
    with pytest.raises(ConfigError, match=r"--dask: got 'tcp://127\.0\.0\.1:1'; allowed: ") as error:
        executor_of(1, "tcp://127.0.0.1:1")
    assert "\n" not in str(error.value)


def test_an_executor_is_one_job_after_the_other_where_it_is_sent(processes):
    assert list(map_jobs(type, [Threads(1)], processes)) == [Here]
