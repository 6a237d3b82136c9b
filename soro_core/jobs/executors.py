"""Executors of this machine: one job after the other, in threads, or in processes."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from soro_core.errors import SoroError

# Libraries of linear algebra have one thread in a worker: others would take the cores of the other workers.
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class LostWorkerError(SoroError):
    """The worker of a job has ended before the job did."""


def all_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Executor:
    """Does jobs; `map_jobs` gives them to it.

    It is not sent to a worker: what holds one has `Here` there.

    Attributes
    ----------
    width : int
        Number of jobs that are given to it at a time.
    """

    width = 1

    def submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        """Begin a job; its exception is a `LostWorkerError` where the worker ended."""
        raise NotImplementedError

    def cancel(self, running: Iterable[Future[Any]]) -> None:
        """Give jobs up, and wait for those that have begun."""
        wait([future for future in running if not future.cancel()])

    def close(self) -> None:
        """Release threads, processes and connections."""

    def __enter__(self) -> Executor:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[type[Here], tuple[()]]:
        return Here, ()


class Here(Executor):
    """Does one job after the other in this thread."""

    def submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        """Do a job."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(item))
        except Exception as error:  # an interrupt is none
            future.set_exception(error)
        return future


class Threads(Executor):
    """Does jobs in threads, for work in compiled loops that do not hold the interpreter's lock.

    Parameters
    ----------
    jobs : int, optional
        Jobs at a time; default one a core.
    """

    def __init__(self, jobs: int | None = None) -> None:
        jobs = jobs or all_cores()
        self.width = 2 * jobs  # a thread finds its next job without this one
        self._pool = ThreadPoolExecutor(jobs)

    def submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        """Begin a job."""
        return self._pool.submit(function, item)

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown(cancel_futures=True)


class Processes(Executor):
    """Does jobs in processes of this machine, which all begin with the first job and stay until `close`.

    Parameters
    ----------
    jobs : int, optional
        Jobs at a time; default one a core.
    """

    def __init__(self, jobs: int | None = None) -> None:
        self.width = jobs or all_cores()
        self._pool: ProcessPoolExecutor | None = None

    def submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        """Begin a job, in new processes where one of the last ones has ended."""
        text, answer = sent(function, item), Future[Any]()
        for _ in range(2):
            try:
                with _one_thread_each():
                    job = self._begun().submit(called, text)
            except BrokenProcessPool:
                self.close()
            else:
                job.add_done_callback(lambda done: _pass_on(done, answer))
                return answer
        answer.set_exception(LostWorkerError("worker processes end as they begin"))
        return answer

    def _begun(self) -> ProcessPoolExecutor:
        """Return the pool with all its processes.

        The end of a process that begins beside a job would be seen at the end of that job.
        """
        if self._pool is None:
            # Not forked: threads and the locks of numba would be copied as they are.
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self.width, context, _ignore_interrupts)
            for _ in range(self.width):
                self._pool.submit(int)
        return self._pool

    def close(self) -> None:
        """End the processes, each after its job."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None


def _pass_on(done: Future[Any], answer: Future[Any]) -> None:
    """Give a job the outcome of its process."""
    if done.cancelled() or not answer.set_running_or_notify_cancel():
        return
    try:
        answer.set_result(done.result())
    except BrokenProcessPool:
        answer.set_exception(LostWorkerError("a worker process ended"))
    except Exception as error:
        answer.set_exception(error)


def sent(function: Callable[[Any], Any], item: Any, dumps: Callable[[Any], bytes] = pickle.dumps) -> bytes:
    """Return a job as it is sent to a worker.

    Raises
    ------
    SoroError
        If that is not possible.
    """
    try:
        return dumps((function, item))
    except Exception as error:  # a function that pickling calls may raise anything
        reason = " ".join(str(error).split())
        raise SoroError(f"a job cannot be sent to another process: {reason}") from None


def called(text: bytes) -> Any:
    """Do a job that was sent; its error can be sent back."""
    function, item = pickle.loads(text)
    try:
        return function(item)
    except Exception as error:
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            raise SoroError(f"{type(error).__name__}: {error}") from None
        raise


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes that begin now have one thread of linear algebra, unless the user says how many."""
    ours = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(ours, "1"))
    try:
        yield
    finally:
        for name in ours:
            del os.environ[name]


def _ignore_interrupts() -> None:
    """Ignore Ctrl-C, which reaches all processes of the terminal; the main process handles it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
