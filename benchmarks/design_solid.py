"""Topology optimisation in space: time and memory of one grid, in a process of its own.

`python -m benchmarks.design_solid 42x34x35` computes any grid of the eighth of a box in space.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.options import Options
from benchmarks.report import met, table
from soro_core.config import with_changes
from soro_design.topology import OptimiserState, load_task, make_domain, optimise, shape

TITLE = "Topology optimisation in space"
TASK = Path(__file__).parents[1] / "tests/soro_design/topology/box.yaml"
# Asked of 10,000 elements on two cores.
CELLS, HOURS, GIGABYTES = "24x20x21", 1.0, 12.0


def solid(options: Options) -> tuple[str, str]:
    """Run one grid, in a process whose memory is that of the run; for tests a coarse one, two iterations."""
    cells, until = options.pick((CELLS, 0), ("8x8x6", 2))
    options.say(f"box, {cells}")
    command = [sys.executable, "-m", "benchmarks.design_solid", cells, "--until", str(until)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, cwd=TASK.parents[3])
    found = json.loads(done.stdout.splitlines()[-1])
    name = f"box, {cells}"
    hours = found["wall_s"] / 3600.0
    rows = [
        (name, "elements; displacements", f"{found['elements']:,}; {found['displacements']:,}", "", ""),
        (name, "iterations", f"{found['iterations']}", "", ""),
        (name, "motion on the grid", f"{found['motion_mm']:.3f} mm", "", ""),
        (name, "leak", found["leak"] or "none", "none", met(not found["leak"])),
        (name, "greyness", f"{found['greyness']:.3f}", "", ""),
        (name, "time of the processor", f"{found['processor_s']:.0f} s", "", ""),
        (name, "time", f"{60.0 * hours:.1f} min", f"<= {60.0 * HOURS:g} min", met(hours <= HOURS)),
        (name, "memory", f"{found['gb']:.1f} GB", f"<= {GIGABYTES:g} GB", met(found["gb"] <= GIGABYTES)),
    ]
    return TITLE, (
        f"{table(('case', '', 'found', 'target', ''), rows)}\n\n"
        f"The task `{TASK.relative_to(TASK.parents[3])}` on a finer grid, one core, SuperLU; other grids: "
        "`python -m benchmarks.design_solid 42x34x35`."
    )


def main() -> None:
    """Run a grid and print what it took as one line of JSON, the iterations on stderr."""
    parser = argparse.ArgumentParser(description="Time of a topology optimisation in space.")
    parser.add_argument("cells", help="elements along x, y and z, such as 24x20x21")
    parser.add_argument("--until", type=int, default=0, help="iteration to stop at (all of the schedule)")
    parser.add_argument("--pressure-pa", type=float, help="last pressure, in place of that of the task")
    given = parser.parse_args()
    task = with_changes(load_task(TASK), cells=tuple(int(n) for n in given.cells.split("x")))
    if given.pressure_pa is not None:
        first = task.schedule.pressure_pa[0]
        pressures = with_changes(task.schedule, pressure_pa=(first, given.pressure_pa))
        task = with_changes(task, schedule=pressures)
    domain = make_domain(task)
    wall_s, processor_s = time.perf_counter(), time.process_time()

    def say(state: OptimiserState) -> None:
        row = state.rows[-1]
        spent = time.perf_counter() - wall_s
        print(
            f"{row.iteration}: {1e3 * row.motion_m:.3f} mm after {spent:.0f} s", file=sys.stderr, flush=True
        )

    state = optimise(task, progress=say, until=given.until or None)
    found = {
        "elements": len(domain.is_solid),
        "displacements": domain.output.size,
        "iterations": len(state.rows),
        "wall_s": time.perf_counter() - wall_s,
        "processor_s": time.process_time() - processor_s,
        "gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        "motion_mm": 1e3 * state.rows[-1].motion_m,
        "greyness": state.rows[-1].greyness,
        "leak": shape(domain, state).leak,
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
