"""Short runs of an ageing twin, in this process, and the folders that they leave.

python -m tests.soro_ros.ageing.aged FOLDER RUNS CYCLES    # then: soro log aged --runs FOLDER/runs
"""

import sys
from datetime import datetime, timedelta
from pathlib import Path

import yaml

from soro_lab.scene import load_scene
from soro_ros.ageing.model_error import keep_model_error
from soro_ros.recordings.learned import keep_learned
from soro_ros.recordings.report import summarise
from soro_ros.recordings.verdict import judge, write
from soro_ros.study.closed_loop import run_in_process

BEGIN = datetime(2026, 3, 2, 9, 0, 0)
KEYS = {
    "name": "aged",
    "robot": "tue_three_bellow",
    "platform": "",
    "mode": "lockstep",
    "duration_s": 4.0,
    "controller": {
        "law": "composite",
        "gains": "auto",
        "reference": {"kind": "circle", "period_s": 4.0, "curvature_per_m": 3.0, "choose_elongation": True},
    },
}


def scene_of(folder, cycles, seed=1, **keys):
    """The scene of a run, read from a file."""
    file = folder / "aged_scene.yaml"
    twin = {"cycles": float(cycles), "refine": 2}
    file.write_text(yaml.safe_dump({**KEYS, "seed": seed, "twin": twin, **keys}), encoding="utf-8")
    return load_scene(file)


def one_run(folder, number, cycles, seed=1, **keys):
    """Run the twin after some cycles, one run a day; return the folder, as `soro run` leaves it."""
    scene = scene_of(folder, cycles, seed, **keys)
    recording, end = run_in_process(scene)
    summary = summarise(recording, scene)
    verdict = judge(summary, scene, end, recording)
    run = folder / "runs" / f"aged-{BEGIN + timedelta(days=number):%Y%m%d-%H%M%S}"
    run.mkdir(parents=True)
    write(run, summary, verdict)
    keep_learned(run, recording, scene)
    keep_model_error(run, recording, scene)
    return run


def all_runs(folder, runs, cycles):
    """Run the twin on so many days, up to so many cycles; return the folder of the runs."""
    for k in range(runs):
        one_run(folder, k, cycles * k / (runs - 1), seed=k + 1)
    return folder / "runs"


if __name__ == "__main__":
    all_runs(Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))
