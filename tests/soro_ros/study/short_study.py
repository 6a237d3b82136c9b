"""A short scene, a study of it with eight runs, and the command that does it."""

import pyarrow.parquet as pq
import yaml
from typer.testing import CliRunner

from soro_ros.cli import application

SCENE = {
    "robot": "tue_three_bellow",
    "rate_hz": 100,
    "duration_s": 0.3,
    "twin": {"pose": {"rate_hz": 50}, "refine": 1},
    "controller": {"law": "composite", "reference": {"start_s": 0.2}},
}
FILE = {
    "samples": 4,
    "seed": 3,
    "vary": {
        "robot.links[0].k_b[0]": {"scale": [0.9, 1.1]},
        "plant.tip_mass": {"uniform": [0.0, 0.01]},
        "seed": {"integers": [1, 1000]},
        "controller.adapt": {"grid": [True, False]},
    },
}


def write(folder):
    (folder / "short.yaml").write_text(yaml.safe_dump(SCENE))
    (folder / "vary.yaml").write_text(yaml.safe_dump(FILE))


def soro(*arguments, file="vary.yaml"):
    return CliRunner().invoke(application(), ["study", "short.yaml", "--vary", file, *arguments])


def table(name="study/short-vary"):
    return pq.read_table(f"{name}/runs.parquet").to_pylist()


def vary(**keys):
    return {"vary": keys}
