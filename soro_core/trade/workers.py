"""Where errors are computed: in this process, in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Protocol

from soro_core.errors import ConfigError, ModelError, SoroError
from soro_core.model.discretised import discretised
from soro_core.trade.candidate import Candidate
from soro_core.trade.case import Case
from soro_core.trade.trace import Errors, Trace, errors, too_slow, trace

_POLL_S = 0.2
_CONNECT_S = 5.0


@dataclass(frozen=True)
class Outcome:
    """Errors of a candidate, or why it has none."""

    candidate: Candidate
    errors: Errors | None
    trouble: str = ""


def compute(case: Case, truth: Trace, candidate: Candidate) -> Outcome:
    """Run one candidate and compare it with the truth."""
    try:
        arm = discretised(case.robot, candidate.model)
        if slow := too_slow(case, arm, candidate.integrator, candidate.dt_s):
            return Outcome(candidate, None, slow)
        found = trace(case, arm, candidate.integrator, candidate.dt_s)
    except (ConfigError, ModelError) as error:
        return Outcome(candidate, None, str(error))
    return Outcome(candidate, errors(found, truth, case.robot.length))


class Workers(Protocol):
    """Computes candidates in any order, until it is told to stop."""

    def run(
        self, case: Case, truth: Trace, candidates: Sequence[Candidate], stop: Callable[[], bool]
    ) -> Iterator[Outcome]:
        """Give each outcome as it is there."""
        ...

    def close(self) -> None:
        """Let go of whatever computes."""
        ...


class Here:
    """One after the other, in this process."""

    def run(
        self, case: Case, truth: Trace, candidates: Sequence[Candidate], stop: Callable[[], bool]
    ) -> Iterator[Outcome]:
        """Give each outcome as it is there."""
        for candidate in candidates:
            if stop():
                return
            yield compute(case, truth, candidate)

    def close(self) -> None:
        """Nothing to let go of."""


class Processes:
    """So many processes of this machine; only while errors are computed, so that times are taken alone."""

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs

    def run(
        self, case: Case, truth: Trace, candidates: Sequence[Candidate], stop: Callable[[], bool]
    ) -> Iterator[Outcome]:
        """Give each outcome as it is there."""
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(self.jobs, mp_context=context, initializer=_ignore_interrupts)
        try:
            waiting: set[Future[Outcome]] = {pool.submit(compute, case, truth, one) for one in candidates}
            while waiting and not stop():
                done, waiting = wait(waiting, timeout=_POLL_S, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        except BrokenProcessPool:
            raise SoroError("--jobs: a worker process ended; use fewer, or --jobs 1") from None
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def close(self) -> None:
        """Nothing to let go of: the processes end with each run."""


class Dask:
    """An existing Dask cluster whose workers have this version of soro.

    Raises
    ------
    ConfigError
        If the package is missing, or nobody answers at the address.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed
        except ImportError:
            raise ConfigError(
                "--dask", "", address, "the package distributed: pip install 'soro[dask]'"
            ) from None
        try:
            self._client: Any = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            allowed = f"the address of a running scheduler, like tcp://host:8786 ({reason})"
            raise ConfigError("--dask", "", address, allowed) from None

    def run(
        self, case: Case, truth: Trace, candidates: Sequence[Candidate], stop: Callable[[], bool]
    ) -> Iterator[Outcome]:
        """Give each outcome as it is there."""
        import distributed

        futures = self._client.map(lambda one: compute(case, truth, one), list(candidates), pure=False)
        try:
            for future in distributed.as_completed(futures, loop=self._client.loop):
                if stop():
                    return
                try:
                    yield future.result()
                except SoroError:
                    raise
                except Exception as error:
                    # Whatever a foreign cluster throws: a lost worker, another version of soro.
                    raise SoroError(f"--dask: a worker failed: {' '.join(str(error).split())}") from None
        finally:
            with contextlib.suppress(Exception):
                self._client.cancel(futures)

    def close(self) -> None:
        """Leave the cluster."""
        self._client.close()


def workers(jobs: int, dask: str) -> Workers:
    """Return what computes: a cluster where an address is given, else so many processes."""
    if dask:
        return Dask(dask)
    return Here() if jobs == 1 else Processes(jobs)


def _ignore_interrupts() -> None:
    """Ctrl-C goes to every process of the terminal; the first one decides."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
