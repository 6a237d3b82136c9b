"""Platform files whose times a machine that is busy, or stands still for a second, does not break."""

import threading
import time
from pathlib import Path
from typing import Any

import yaml

from soro_core.config import find_config, read_yaml

LIMIT_S = 60.0
"""Longest wait of a test for what comes at once on an idle machine: no bound of the product."""

COMPILED_S = 240.0
"""The same of a node that may first compile its kernels."""

STILL_S = 0.05
"""Where a machine gives a program no time for so long, the shortest deadlines of our platforms break."""


class StandStill:
    """Measures meanwhile how long this machine gives a program no time at most: a context manager."""

    def __init__(self) -> None:
        self.longest_s = 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def _watch(self) -> None:
        before, period_s = time.monotonic(), 0.01
        while not self._ended.wait(period_s):
            now = time.monotonic()
            self.longest_s, before = max(self.longest_s, now - before - period_s), now

    def __enter__(self) -> "StandStill":
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        self._thread.join()


# How long a driver waits for answers at its start and end. This takes real time in lockstep as well.
_ANSWERS: dict[str, dict[str, Any]] = {
    "canopen_408": {"canopen": {"sdo_timeout_s": 5.0, "boot_timeout_s": 60.0, "activation_timeout_s": 5.0}},
    "itv_rs232": {"line": {"answer_timeout_s": 2.0, "boot_timeout_s": 60.0}},
    "veab_tcp": {"transport": {"connect_timeout_s": 10.0}, "host": {"vent_timeout_s": 10.0}},
    "vtem_modbus": {
        "transport": {"connect_timeout_s": 10.0},
        "host": {"answer_timeout_s": 10.0, "start_timeout_s": 60.0, "stop_timeout_s": 60.0},
    },
}
# `canopen` of a platform whose cycles may be late in real time, up to the bounds of its keys: a busy machine
# may keep a process off its core for longer than the watchdogs of the shipped files allow.
LATE_CYCLES = {"heartbeat_consumer_s": 1.0, "rpdo_deadline_s": 0.5, "stale_cycles": 100, "stale_s": 0.5}


def patient_platform(folder: Path, name: str = "emulated_canopen", real_time: bool = True) -> Path:
    """Write a shipped platform with longer times for answers into a folder.

    Parameters
    ----------
    folder : Path
        Where the file is written.
    name : str
        Of the shipped platform.
    real_time : bool
        Whether its cycles may be late as well (CANopen alone). In lockstep they never are.
    """
    platform = read_yaml(find_config(name, "platforms"))
    sections = {key: dict(values) for key, values in _ANSWERS[platform["family"]].items()}
    if real_time:
        sections["canopen"] |= LATE_CYCLES
    for key, values in sections.items():
        platform[key] = {**platform.get(key, {}), **values}
    platform["lockstep_timeout_s"] = 60.0
    file = folder / f"patient_{name}.yaml"
    file.write_text(yaml.safe_dump(platform))
    return file
