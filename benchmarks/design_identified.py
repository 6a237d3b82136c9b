"""Robots identified from finite elements: their tips against those of the part, and under control."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from benchmarks.options import Options
from benchmarks.report import figure, met, table
from soro_core.config import with_changes
from soro_core.twin import Twin
from soro_design.parts.file import PartFile, load_part
from soro_design.parts.geometry import RodGeometry
from soro_design.parts.specimen import RodSpecimen, make_specimen
from soro_design.parts.sweeps import Backbone, backbone, follow
from soro_design.robot_of_part.snapshots import snapshots
from soro_design.robot_of_part.stages import PartIdentification, identify, mesh_check
from soro_design.robot_of_part.written import mean_and_most, write_robot
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of

TITLE = "Robots identified from finite elements"
PARTS = ("silicone_rod_three_chambers", "tapered_rod_three_chambers")
# Of the tip over the length: mean and greatest of fitted states, greatest held out, and under control.
MEAN, MOST, HELD_OUT, CONTROL = 0.015, 0.03, 0.04, 0.02
# Constant strain over two modes, and minutes for sweeps and fits.
GAIN, MINUTES = 3.0, 10.0
SECONDS = 12.0
SCENE = {
    "platform": "",
    "mode": "lockstep",
    "duration_s": SECONDS,
    "twin": {"refine": 1},
    "controller": {
        "reference": {
            "kind": "circle",
            "period_s": 6.0,
            "curvature_per_m": 3.0,
            "choose_elongation": True,
            "mean_pressure_pa": 20e3,
        }
    },
}


def identified(options: Options) -> tuple[str, str]:
    """Return title and text: all sweeps, fits, modes, and a circle of the tip under control."""
    rows = [_row(name, options) for name in options.pick(PARTS, PARTS[1:])]
    head = ["part", "elements", "fitted, mean", "greatest", "held out, mean", "greatest", "mesh"]
    head += ["strains missed, constant", "2 modes", "under control", "min", "of them busy", "all targets"]
    text = (
        "`soro identify-fem` of the shipped rods. Tips in % of the length: of the link against finite"
        f" elements (targets: mean {100 * MEAN:g}, greatest {100 * MOST:g} fitted, {100 * HELD_OUT:g} held"
        " out); what the mesh leaves; and of a twin with one mode of each strain, which the controller of the"
        " link with constant strain leads along a circle, root mean square of the last 6 s (target"
        f" {100 * CONTROL:g}). Strains missed: root mean square in %, of the fitted states by projection"
        f" (target: two modes {GAIN:g} times better than constant strain). Minutes: sweeps and first fit, at"
        f" most {MINUTES:g}."
    )
    return TITLE, f"{text}\n\n{table(head, rows)}"


def _row(name: str, options: Options) -> list[str]:
    start, started = time.perf_counter(), time.process_time()
    file = _coarse(load_part(name)) if options.quick else load_part(name)
    specimen = make_specimen(file)
    assert isinstance(specimen, RodSpecimen)
    states = _states(file, specimen, lambda sweep: options.say(f"{name}, {sweep}"))
    data = snapshots(specimen.z, states, name)
    found = replace(identify(file, specimen, data, name), mesh=mesh_check(file, specimen, data))
    minutes = (time.perf_counter() - start) / 60.0
    busy = (time.process_time() - started) / 60.0
    options.say(f"{name}, control")
    varying = identify(file, specimen, data, f"{name}_modes", 1)
    tip = under_control(found, varying)
    mean, most = mean_and_most(found.fitted)
    held_mean, held_most = mean_and_most(found.held_out)
    constant, two = (found.kept[n][0].strain for n in (0, 2))
    good = mean <= MEAN and most <= MOST and held_most <= HELD_OUT and constant >= GAIN * two
    good = good and tip <= CONTROL and minutes <= MINUTES
    shares = [figure(100.0 * share, 2) for share in (mean, most, held_mean, held_most)]
    assert found.mesh is not None
    return [
        name,
        str(found.mesh.elements),
        *shares,
        figure(100.0 * found.mesh.error, 2),
        *(figure(100.0 * share, 2) for share in (constant, two, tip)),
        figure(minutes, 2),
        figure(busy, 2),
        met(good),
    ]


def _coarse(file: PartFile) -> PartFile:
    geometry = file.geometry
    assert isinstance(geometry, RodGeometry)
    sweeps = tuple(with_changes(sweep, states=min(sweep.states, 2)) for sweep in file.sweeps)
    return with_changes(file, geometry=with_changes(geometry, around=2, across=1, along=6), sweeps=sweeps)


def _states(file: PartFile, specimen: RodSpecimen, say: Callable[[str], None]) -> list[Backbone]:
    states: list[Backbone] = []
    for sweep in file.sweeps:
        say(sweep.name)
        states += [backbone(specimen, sweep, one) for one in follow(specimen, sweep, lambda one: None).states]
    return states


def under_control(robot: PartIdentification, plant: PartIdentification) -> float:
    """Return the error of the tip on a circle, root mean square of the last 6 s over the length."""
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{one.known.name}.yaml" for one in (robot, plant)]
        for one, path in zip((robot, plant), files, strict=True):
            write_robot(one, one.known.name, path)
        scene_file = Path(folder) / "scene.yaml"
        scene = {**SCENE, "robot": str(files[0]), "twin": {**SCENE["twin"], "plant": str(files[1])}}
        scene_file.write_text(yaml.safe_dump(scene), encoding="utf-8")
        loaded = load_scene(scene_file)
        loop, twin = loop_of(loaded), Twin(loaded.loaded_robot, loaded.twin_node())
    ticks = round(SECONDS * loaded.rate_hz)
    far = [
        float(np.linalg.norm(tick.seen.tip[:3, 3] - tick.command.tip_reference[:3, 3]))
        for tick in loop.run(twin, ticks, 1.0 / loaded.rate_hz)
    ]
    late = np.array(far[-round(6.0 * loaded.rate_hz) :])
    return float(np.sqrt(np.mean(late**2))) / robot.data.length
