"""A thread that keeps a VEAB server alive, and its arm empty, while the control loop is silent."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Keeper:
    """Calls `keep` again and again until `stop`.

    Parameters
    ----------
    keep : callable
        What to do; it must not wait.
    period_s : float
        Pause between two calls.
    """

    def __init__(self, keep: Callable[[], None], period_s: float) -> None:
        self._keep, self._period_s = keep, period_s
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="veab keeper", daemon=True)
        self._thread.start()

    @property
    def is_alive(self) -> bool:
        """Whether it still does its work."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stopped.wait(self._period_s):
            self._keep()
