"""Start-up in fresh processes: import, first tick and compiling, with a cold and with a warm cache."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.options import Options
from benchmarks.report import met, table

TITLE = "Start-up"
WARM_S, COLD_S = 2.0, 45.0

# Seconds are CPU time of the process, which others on the machine do not change.
PROLOGUE = """
import json, time
clock = time.process_time
start = clock()
from numba.core import event

class Spans(event.Listener):
    stack, total = 0, 0.0

    def on_start(self, one):
        self.stack += 1
        if self.stack == 1:
            self.since = clock()

    def on_end(self, one):
        self.stack -= 1
        if self.stack == 0:
            self.total += clock() - self.since

compiling = Spans()
event.register("numba:compile", compiling)
import numpy as np
"""
MODEL = """
from soro_core import SoftArm, load_robot
from soro_core.integrate import make_stepper
imported = clock()
arm = SoftArm(load_robot("tue_three_bellow"))
stepper = make_stepper("trapezoidal", arm)
state, status = stepper.step(stepper.initial_state(), np.full(arm.n_u, 1e4), 1e-3)
assert status.ok, status
"""
LOOP = """
from soro_core import load_robot
from soro_core.control import Controller, ControllerConfig
from soro_core.estimation import Estimator, EstimatorConfig
from soro_core.loop import Loop
imported = clock()
robot = load_robot("tue_three_bellow")
loop = Loop(Estimator(robot, EstimatorConfig(), 0.005), Controller(robot, ControllerConfig()))
state = loop.initial_state(0.0)
loop.step(state, np.zeros(3), [], [], 0.005)
"""
EPILOGUE = """
ticked = clock()
print(json.dumps({"import": imported - start, "tick": ticked - imported, "compiling": compiling.total}))
"""
SCRIPTS = {
    "model: first step of the trapezoidal stepper": PROLOGUE + MODEL + EPILOGUE,
    "closed loop: first tick of estimator and controller": PROLOGUE + LOOP + EPILOGUE,
}


def run(options: Options) -> str:
    """Measure and write."""
    rows = []
    for name, script in list(SCRIPTS.items())[: options.pick(2, 1)]:
        with tempfile.TemporaryDirectory(prefix="soro-benchmark-") as cache:
            cold = None
            if not options.quick:
                options.say(f"{name}, cold cache (compiling)")
                cold = process(script, cache)
            options.say(f"{name}, warm cache")
            warm = [process(script, None if options.quick else cache) for _ in range(options.pick(5, 1))]
            files = list(Path(cache).rglob("*.nbc"))
        parts = [statistics.median(one[key] for one in warm) for key in ("import", "tick", "total")]
        row: list[object] = [name, *(f"{seconds:.2f}" for seconds in parts)]
        row[-1] = f"{row[-1]} ({met(parts[-1] <= WARM_S)})"
        if cold:
            row += [f"{cold['total']:.1f} ({met(cold['total'] <= COLD_S)})", f"{cold['wall']:.1f}"]
            row += [f"{cold['compiling']:.1f}", len(files)]
        rows.append(row + ["-"] * (8 - len(row)))
    head = ["fresh process", "import, s", "first tick, s", f"whole, s (to reach {WARM_S:g})"]
    head += [f"cold cache, s (to reach {COLD_S:g})", "its wall time, s", "of it compiling, s", "kernels kept"]
    intro = (
        "Whole: from the start of the Python process to its end. Median of five with a warm cache, one cold. "
        "CPU time, which is what the wall shows on a machine that does nothing else."
    )
    return f"{intro}\n\n{table(head, rows)}"


def process(script: str, cache: str | None) -> dict[str, float]:
    """Run a script in a process of its own, its compiled kernels in `cache`."""
    environment = dict(os.environ) if cache is None else {**os.environ, "XDG_CACHE_HOME": cache}
    root = Path(__file__).resolve().parent.parent
    environment["PYTHONPATH"] = os.pathsep.join([str(root), environment.get("PYTHONPATH", "")])
    start, cpu = time.perf_counter(), children_s()
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment, cwd=root
    )
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    wall, cpu = time.perf_counter() - start, children_s() - cpu
    return {**json.loads(done.stdout), "wall": wall, "total": min(wall, cpu)}


def children_s() -> float:
    """CPU time of all processes that have ended."""
    used = os.times()
    return used.children_user + used.children_system
