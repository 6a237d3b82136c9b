"""A thread that keeps a VEAB server running, at 0 Pa, while the control loop pauses."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Keeper:
    """Calls `keep` periodically until `stop`.

    Parameters
    ----------
    keep : callable
        Function to call; it must not block.
    period_s : float
        Pause between two calls [s].
    """

    def __init__(self, keep: Callable[[], None], period_s: float) -> None:
        self._keep, self._period_s = keep, period_s
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="veab keeper", daemon=True)
        self._thread.start()

    @property
    def is_alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stopped.wait(self._period_s):
            self._keep()
