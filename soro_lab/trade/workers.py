"""Computation of errors in this process, in processes of this machine, or on a Dask cluster."""

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
from soro_lab.trade.candidate import Candidate
from soro_lab.trade.case import TradeCase
from soro_lab.trade.trace import Errors, TradeTrace, errors, too_slow, trace

_POLL_S = 0.2
_CONNECT_S = 5.0


@dataclass(frozen=True)
class Outcome:
    """Errors of a candidate, or why it has none."""

    candidate: Candidate
    errors: Errors | None
    failure: str = ""


def compute(case: TradeCase, truth: TradeTrace, candidate: Candidate) -> Outcome:
    """Compute the errors of one candidate.

    Parameters
    ----------
    case : TradeCase
        Start and pressures.
    truth : TradeTrace
        Reference.
    candidate : Candidate
        Discretisation, stepper and step.

    Returns
    -------
    Outcome
    """
    try:
        arm = discretised(case.robot, candidate.model)
        if slow := too_slow(case, arm, candidate.integrator, candidate.dt_s):
            return Outcome(candidate, None, slow)
        found = trace(case, arm, candidate.integrator, candidate.dt_s)
    except (ConfigError, ModelError) as error:
        return Outcome(candidate, None, str(error))
    return Outcome(candidate, errors(found, truth, case.robot.length))


class Workers(Protocol):
    """Computes the errors of candidates."""

    def run(
        self, case: TradeCase, truth: TradeTrace, candidates: Sequence[Candidate], stop: Callable[[], bool]
    ) -> Iterator[Outcome]:
        """Yield the outcomes in the order of completion.

        Parameters
        ----------
        case : TradeCase
            Start and pressures.
        truth : TradeTrace
            Reference.
        candidates : sequence of Candidate
            Candidates.
        stop : callable
            Function that returns whether to stop.
        """
        ...

    def close(self) -> None:
        """Release processes and connections."""
        ...


class Here:
    """Computes one candidate after the other in this process."""

    def run(
        self, case: TradeCase, truth: TradeTrace, candidates: Sequence[Candidate], stop: Callable[[], bool]
    ) -> Iterator[Outcome]:
        """Yield the outcomes in the order of completion; parameters as in `Workers.run`."""
        for candidate in candidates:
            if stop():
                return
            yield compute(case, truth, candidate)

    def close(self) -> None:
        """Do nothing: there is nothing to release."""


class Processes:
    """Computes in processes of this machine, which end before times are measured."""

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs

    def run(
        self, case: TradeCase, truth: TradeTrace, candidates: Sequence[Candidate], stop: Callable[[], bool]
    ) -> Iterator[Outcome]:
        """Yield the outcomes in the order of completion; parameters as in `Workers.run`."""
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
        """Do nothing: the processes end with each run."""


class Dask:
    """Computes on an existing Dask cluster whose workers have this version of soro.

    Raises
    ------
    ConfigError
        If the package is missing, or the address does not answer.
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
        self, case: TradeCase, truth: TradeTrace, candidates: Sequence[Candidate], stop: Callable[[], bool]
    ) -> Iterator[Outcome]:
        """Yield the outcomes in the order of completion; parameters as in `Workers.run`."""
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
                    # A cluster may raise anything: a lost worker, another version of soro.
                    raise SoroError(f"--dask: a worker failed: {' '.join(str(error).split())}") from None
        finally:
            with contextlib.suppress(Exception):
                self._client.cancel(futures)

    def close(self) -> None:
        """Disconnect from the cluster."""
        self._client.close()


def workers(jobs: int, dask: str) -> Workers:
    """Return a cluster for an address, else `jobs` processes."""
    if dask:
        return Dask(dask)
    return Here() if jobs == 1 else Processes(jobs)


def _ignore_interrupts() -> None:
    """Ignore Ctrl-C, which reaches all processes of the terminal; the main process handles it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
