"""How often an arm that nothing touches says that something does: scenes, and arms unlike their file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.mismatch import CASES, scene_of
from benchmarks.options import Options
from benchmarks.report import met, table
from soro_lab.scene import Scene, load_scene
from soro_ros.study.closed_loop import ticks_of

SCENES = ("track_circle", "hanging_arm", "two_links", "line_and_square")
STAGES = ("outside force", "contact")


def counted(scene: Scene) -> list[str]:
    """Return how often each stage begins, how long it lasts in all [s], and when the first begins."""
    stage, begun, lasted, first = "free", dict.fromkeys(STAGES, 0), dict.fromkeys(STAGES, 0.0), "-"
    for tick in ticks_of(scene):
        external = tick.estimate.external
        now = "free" if external is None else external.stage
        if now != stage and now in begun:
            begun[now] += 1
            first = f"{tick.t_s:.1f}" if now == "contact" and first == "-" else first
        if now in lasted:
            lasted[now] += 1.0 / scene.rate_hz
        stage = now
    each = (f"{begun[stage]} ({lasted[stage]:.1f} s)" for stage in STAGES)
    return [*each, first, met(not begun["contact"])]


def rows(options: Options) -> Iterator[list[str]]:
    """Give the rows: scenes, then the arms of the mismatch benchmark with seed 1."""
    for name in options.pick(SCENES, SCENES[:1]):
        options.say(f"force: nothing touches {name}")
        keys = {"mode": "lockstep", "platform": "", "duration_s": 60.0 * options.minutes}
        yield [f"{name}, {options.minutes:g} min", *counted(load_scene(name, keys))]
    for case in options.pick(CASES, CASES[:1]):
        options.say(f"force: nothing touches {case.name}")
        with TemporaryDirectory() as folder:
            yield [case.name, *counted(scene_of(case, "composite", 1, Path(folder)))]


def section(options: Options) -> str:
    """Return the table."""
    header = ["what", "outside force", "contact", "first contact s", ""]
    return table(header, list(rows(options)))
