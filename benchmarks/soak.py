"""A long run of the composed process: does its memory grow, or its file handles? ``make soak``.

``python -m benchmarks.soak --minutes 10 --rate-hz 200``: starts the arm as a user would, without a recorder,
and looks from outside once a second. Exit status 1 where memory or handles grow, or the control has ended.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from benchmarks.composed_arm import parameter_file
from benchmarks.report import figure, table
from soro_core.errors import SoroError
from soro_ros.run.supervisor import RunMonitor
from soro_ros.topics.diagnostics import ERROR

NAMESPACE = "soak"
START_S = 240.0
# Part of the run that does not count: caches fill, the allocator finds its size.
WARM_UP = 0.2
# Growth of the fitted line from the end of the warm-up on, above which a run fails.
MOST_MB, MOST_HANDLES = 2.0, 0.5
_PAGE_B = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Look:
    """What one look has found.

    Attributes
    ----------
    t_s : float
        Time since the first look [s].
    rss_mb : float
        Resident memory [MB].
    handles, threads : int
        Open file handles, and threads.
    cpu_s : float
        CPU time so far [s].
    ticks : int
        Ticks of the twin so far, those that it skipped included.
    skipped : int
        Ticks that it skipped so far.
    """

    t_s: float
    rss_mb: float
    handles: int
    threads: int
    cpu_s: float
    ticks: int
    skipped: int


def look(pid: int, values: dict[str, str], t_s: float) -> Look:
    """Look at a process, with the last values of its twin on /diagnostics."""
    of = Path(f"/proc/{pid}")
    stat = (of / "stat").read_text().rsplit(")", 1)[1].split()
    cpu_s = (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")
    rss_mb = int((of / "statm").read_text().split()[1]) * _PAGE_B / 1e6
    ticks, skipped = int(values.get("tick", 0)), int(values.get("skipped_ticks", 0))
    handles, threads = len(list((of / "fd").iterdir())), len(list((of / "task").iterdir()))
    return Look(t_s, rss_mb, handles, threads, cpu_s, ticks + skipped, skipped)


def watched(process: subprocess.Popen[bytes], supervisor: RunMonitor, seconds: float) -> list[Look]:
    """Look once a second for a time, from the moment on in which the arm is in control.

    Raises
    ------
    SoroError
        If a node reports an error, as of a vented arm, or the process ends.
    """

    def alive() -> None:
        if process.poll() is not None:
            raise SoroError(f"the process has ended with status {process.returncode}")

    names = ("estimator", "controller", "twin")
    supervisor.wait("nodes", lambda: all(map(supervisor.active, names)), alive, START_S)
    supervisor.wait("set point", lambda: supervisor.controlled_s > 0.0, alive, START_S)
    begin, looks = time.monotonic(), []
    while (t_s := time.monotonic() - begin) < seconds:
        supervisor.spin(1.0)
        alive()
        for name, status in supervisor.status.items():
            if status.level == ERROR:
                raise SoroError(f"{name}: {status.message}")
        looks.append(look(process.pid, supervisor.values("twin"), t_s))
    return looks


def growth(looks: list[Look], name: str) -> float:
    """Growth of a number after the warm-up, by the line that fits it best."""
    late = looks[round(WARM_UP * len(looks)) :]
    t = np.array([one.t_s for one in late])
    slope = np.polyfit(t - t[0], [float(getattr(one, name)) for one in late], 1)[0]
    return float(slope * (t[-1] - t[0]))


def rows(looks: list[Look], parts: int = 10) -> list[list[object]]:
    """Return a row for each part of the run."""
    found: list[list[object]] = []
    for part in np.array_split(np.arange(len(looks)), min(parts, len(looks) // 2)):
        first, last = looks[part[0]], looks[part[-1]]
        took = last.t_s - first.t_s
        found.append(
            [
                f"{last.t_s:.0f}",
                figure(last.rss_mb, 5),
                last.handles,
                last.threads,
                f"{100 * (last.cpu_s - first.cpu_s) / took:.0f} %",
                figure((last.ticks - first.ticks) / took, 4),
                last.skipped - first.skipped,
            ]
        )
    return found


def soak(
    minutes: Annotated[float, typer.Option(min=0.1, help="duration [min]")] = 10.0,
    rate_hz: Annotated[float, typer.Option(min=1.0, max=1000.0, help="rate of the loop [1/s]")] = 200.0,
) -> None:
    """Run the composed process for a long time; exit status 1 where its memory or its handles grow."""
    console = Console()
    with tempfile.TemporaryDirectory(prefix="soro-") as folder:
        parameters = parameter_file(Path(folder), rate_hz)
        arguments = ["--ros-args", "-r", f"__ns:=/{NAMESPACE}", "--params-file", str(parameters)]
        process = subprocess.Popen([sys.executable, "-m", "soro_ros.nodes.arm", *arguments])
        try:
            with RunMonitor(NAMESPACE) as supervisor:
                looks = watched(process, supervisor, 60.0 * minutes)
        except SoroError as error:
            console.print(f"soak: {error}", markup=False, soft_wrap=True)
            raise typer.Exit(1) from None
        finally:
            process.terminate()
            process.wait()
    head = ["until, s", "memory, MB", "handles", "threads", "CPU", "ticks a second", "skipped"]
    console.print(table(head, rows(looks)), markup=False, soft_wrap=True)
    memory, handles = growth(looks, "rss_mb"), growth(looks, "handles")
    grows = memory > MOST_MB or handles > MOST_HANDLES
    text = (
        f"after the first {100 * WARM_UP:.0f} %: memory {memory:+.2f} MB (at most {MOST_MB:g}), "
        f"handles {handles:+.2f} (at most {MOST_HANDLES:g}): {'grows' if grows else 'flat'}"
    )
    console.print(text, markup=False, soft_wrap=True)
    raise typer.Exit(1 if grows else 0)


if __name__ == "__main__":
    typer.run(soak)
