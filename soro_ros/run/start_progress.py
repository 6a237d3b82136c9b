"""How far the start of a run is: nodes that are ready, and kernels that they have compiled."""

from __future__ import annotations

import time
from collections.abc import Callable

from soro_ros.process import kernels

# Time between two lines [s]; longest wait for the next kernel before the time of the start runs on [s].
TELL_S, KERNEL_LIMIT_S = 10.0, 900.0


class StartProgress:
    """Tells how far the nodes of a run are while they compile.

    Parameters
    ----------
    report : callable
        Function that shows one line of progress.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._before, self._done = kernels.compiled(), 0
        self._start_s = self._moved_s = time.monotonic()
        self._told_s = self._looked_s = -TELL_S

    def tell(self, ready: int, of: int) -> None:
        """Say how many kernels are compiled, when there is one and then every `TELL_S` while it goes on.

        Parameters
        ----------
        ready, of : int
            Nodes that are active, and those that have been started.
        """
        now_s = time.monotonic()
        # To count takes milliseconds, more in a large cache.
        if now_s - self._looked_s < TELL_S / 10 or not kernels.are_compiled_now():
            return
        self._looked_s, done = now_s, kernels.compiled() - self._before
        has_moved = done > self._done
        if has_moved:
            self._done, self._moved_s = done, now_s
        if done and now_s - self._told_s >= TELL_S and (has_moved or self.is_compiling()):
            self._told_s = now_s
            self._report(
                "compiling kernels of the model, once (some 3 minutes of a free core): "
                f"{done} done in {now_s - self._start_s:.0f} s, {ready} of {of} nodes ready"
            )

    def is_compiling(self) -> bool:
        """Return whether a node compiles, and has not been at one kernel for too long."""
        return time.monotonic() - self._moved_s < KERNEL_LIMIT_S and kernels.are_compiled_now()
