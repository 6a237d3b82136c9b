"""The driver's end of the supervisor process (`soro_core.hardware.supervisor`)."""

from __future__ import annotations

import contextlib
import json
import select
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from soro_core.errors import HardwareError

SCRIPT = Path(__file__).with_name("supervisor.py")
START_LIMIT_S = 10.0
_END_LIMIT_S = 2.0


class Supervisor:
    """A process that vents when this one dies.

    Raises
    ------
    HardwareError
        If it cannot be started.
    """

    def __init__(self) -> None:
        try:
            # Isolated, and in a session of its own: what is sent to the driver's group is not for it.
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", str(SCRIPT)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
                cwd="/",
            )
        except OSError as error:
            raise HardwareError(f"supervisor: cannot start ({error})") from None

    @property
    def is_alive(self) -> bool:
        """Whether it would act."""
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def arm(self, plan: Sequence[dict[str, Any]]) -> None:
        """Tell it what to do, and see that it listens.

        Raises
        ------
        HardwareError
            If it does not.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(list(plan)).encode() + b"\n")
            self._process.stdin.flush()
        except OSError as error:
            raise HardwareError(f"supervisor: it has gone ({error})") from None
        self._await_ready()

    def dismiss(self) -> None:
        """End it without a vent; never raises."""
        process = self._process
        for pipe, last_word in ((process.stdin, b"end\n"), (process.stdout, b"")):
            with contextlib.suppress(OSError):
                if pipe is not None and not pipe.closed:
                    if last_word:
                        pipe.write(last_word)
                    pipe.close()
        try:
            process.wait(_END_LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _await_ready(self) -> None:
        stdout = self._process.stdout
        if stdout is None or stdout.closed:
            return
        is_ready = bool(select.select([stdout], [], [], START_LIMIT_S)[0]) and bool(stdout.readline())
        stdout.close()
        if not is_ready:
            raise HardwareError(f"supervisor: not ready within {START_LIMIT_S:g} s")
