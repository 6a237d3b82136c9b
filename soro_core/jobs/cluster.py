"""An executor of a Dask cluster whose workers have the same soro."""

from __future__ import annotations

import logging
import time
import warnings
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from functools import partial
from typing import Any

from soro_core.errors import ConfigError, SoroError
from soro_core.jobs.executors import Executor, called, sent
from soro_core.jobs.versions import fingerprint

# Longest wait for the scheduler and for its first worker, and age of the known number of threads [s].
_CONNECT_S, _COUNT_S = 5.0, 1.0


class Dask(Executor):
    """Does jobs on a Dask cluster, which does those of a lost worker again.

    Parameters
    ----------
    address : str
        Of its scheduler.

    Raises
    ------
    ConfigError
        If the package is missing, the address does not answer, it has no worker, or a worker has another
        soro, other sources, or another numpy, scipy, numba or Python.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed
            from distributed.protocol.pickle import dumps
        except ImportError:
            raise ConfigError(
                "--dask", "", address, "the package distributed: pip install 'soro[dask]'"
            ) from None
        self._dumps, self._address = dumps, address
        self._width, self._counted_s = 0, 0.0
        logging.getLogger("distributed").setLevel(logging.ERROR)  # it warns of each lost worker
        try:
            self._client: Any = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            self._refuse(f"the address of a running scheduler, like tcp://host:8786 ({reason})")
        self._theirs: dict[Future[Any], Any] = {}
        try:
            self._check()
        except BaseException:
            self.close()
            raise

    @property
    def width(self) -> int:  # type: ignore[override]
        """Two jobs a thread of the cluster as it is now, so that none waits for the network."""
        if time.monotonic() - self._counted_s > _COUNT_S:
            self._counted_s = time.monotonic()
            self._width = 2 * sum(self._client.nthreads().values())
        return self._width

    def submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        """Begin a job."""
        answer: Future[Any] = Future()
        text = sent(function, item, self._dumps)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph")  # a part or a recording has megabytes
            theirs = self._client.submit(_called_by, fingerprint(), text, pure=False)
        self._theirs[answer] = theirs
        theirs.add_done_callback(partial(self._take, answer))
        return answer

    def cancel(self, running: Iterable[Future[Any]]) -> None:
        """Give jobs up, also those that have begun."""
        given_up = [future for future in running if future.cancel()]
        self._client.cancel([self._theirs.pop(future) for future in given_up if future in self._theirs])

    def close(self) -> None:
        """Disconnect from the cluster."""
        self._client.close()

    def _take(self, answer: Future[Any], theirs: Any) -> None:
        """Take the result of a job, which the cluster may then forget."""
        self._theirs.pop(answer, None)
        if not answer.set_running_or_notify_cancel():
            return
        try:
            answer.set_result(theirs.result())
        except SoroError as error:
            answer.set_exception(error)
        except BaseException as error:  # a lost scheduler, workers that end again and again
            reason = " ".join(str(error).split()) or type(error).__name__
            answer.set_exception(SoroError(f"--dask: a worker failed: {reason}"))

    def _check(self) -> None:
        """Refuse a cluster without workers, and workers of other versions."""
        try:
            self._client.wait_for_workers(1, timeout=_CONNECT_S)
        except TimeoutError:
            self._refuse("a cluster with workers: dask worker ADDRESS --nthreads 1")

        def ask() -> str:  # a function in a function is sent whole: also a worker without soro answers
            try:
                from soro_core.jobs.versions import fingerprint
            except ImportError as error:
                return f"none that computes jobs ({error})"
            return fingerprint()

        for worker, found in self._client.run(ask, on_error="return").items():
            if found != fingerprint():
                self._refuse(_same(worker, str(found)))

    def _refuse(self, allowed: str) -> None:
        raise ConfigError("--dask", "", self._address, allowed)


def _same(worker: str, found: str) -> str:
    return f"workers with {fingerprint()}, as here; {worker} has {found}"


def _called_by(asked: str, text: bytes) -> Any:
    """Do a job on a worker, which may have come after the others were asked for their versions."""
    if (found := fingerprint()) != asked:
        raise ConfigError("--dask", "", found, f"workers with {asked}, as here")
    return called(text)
