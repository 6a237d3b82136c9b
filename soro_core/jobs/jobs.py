"""Jobs: a function of each item, computed by an executor."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import TypeVar

from soro_core.errors import ConfigError, SoroError
from soro_core.jobs.executors import Executor, Here, LostWorkerError, Processes, Threads

Item = TypeVar("Item")
Done = TypeVar("Done")

# Time between two questions whether to stop [s].
_POLL_S = 0.2
# A job whose worker ended so often is not tried again: it is likely what ends them.
_MOST_LOSSES = 3


def map_jobs(
    function: Callable[[Item], Done],
    items: Iterable[Item],
    executor: Executor,
    in_order: bool = True,
    stop: Callable[[], bool] = lambda: False,
) -> Generator[Done, None, None]:
    """Yield what a function returns for each item; the results do not depend on the executor.

    Items are taken as they are needed. A job whose worker ends is done again, alone: a job beside it may have
    ended the worker. Close the iterator to give up
    what has not begun; an interrupt in it does so.

    Parameters
    ----------
    function : callable
        Of a module, or a `functools.partial` of one, where processes or a cluster compute.
    items : iterable
    executor : Executor
    in_order : bool
        Whether results, and the first error, come in the order of the items; else as they are done.
    stop : callable
        Asked between jobs whether to begin no more; those that have begun come to their end, and, in order
        or not, all that is done is yielded.

    Raises
    ------
    SoroError
        If a worker ended too often at a job, or a job cannot be sent; else what the function raises.
    """
    numbered, again = iter(enumerate(items)), list[tuple[int, Item]]()
    running, losses = dict[Future[Done], tuple[int, Item]](), dict[int, int]()
    done, due = dict[int, Future[Done]](), 0
    is_stopped = False
    try:
        while True:
            while not (is_stopped := is_stopped or stop()):
                is_alone = again or any(number in losses for number, _ in running.values())
                if len(running) >= (1 if is_alone else max(1, executor.width)):
                    break
                # The fewest losses first: what ends its worker each time comes behind the others.
                job = min(again, key=lambda one: losses[one[0]]) if again else next(numbered, None)
                if job is None:
                    break
                if again:
                    again.remove(job)
                running[executor.submit(function, job[1])] = job
            if not running:
                break
            for future in wait(running, _POLL_S, FIRST_COMPLETED).done:
                number, item = running.pop(future)
                if isinstance(future.exception(), LostWorkerError):
                    losses[number] = losses.get(number, 0) + 1
                    if losses[number] == _MOST_LOSSES:
                        raise SoroError(f"{future.exception()} {_MOST_LOSSES} times at job {number}")
                    again.append((number, item))
                elif in_order:
                    done[number] = future
                else:
                    yield future.result()
                del future  # nothing keeps a result that was taken
            while due in done:
                yield done.pop(due).result()
                due += 1
            if is_stopped and executor.width == 0:  # nobody is left to finish
                break
        for number in sorted(done):
            yield done[number].result()
    finally:
        executor.cancel(running)


def given_or_threads(
    executor: Executor | None, jobs: int | None = None
) -> contextlib.AbstractContextManager[Executor]:
    """Return a context with an executor that stays open, or, without one, with threads that it ends."""
    return Threads(jobs) if executor is None else contextlib.nullcontext(executor)


def executor_of(
    jobs: int | None, dask: str = "", several: Callable[[int | None], Executor] = Processes
) -> Executor:
    """Return the executor of the options --jobs and --dask; close it.

    Parameters
    ----------
    jobs : int or None
        Number of jobs at a time on this machine; None: one a core.
    dask : str
        Address of a Dask scheduler, in place of this machine; empty for none.
    several : callable
        Makes the executor of more jobs than one.

    Raises
    ------
    ConfigError
        If both are given, or the cluster cannot be used.
    """
    if not dask:
        return Here() if jobs == 1 else several(jobs)
    if jobs is not None and jobs > 1:
        raise ConfigError("--jobs", "", jobs, "either --jobs or --dask")
    from soro_core.jobs.cluster import Dask

    return Dask(dask)
