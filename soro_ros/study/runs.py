"""The runs of a study: each a scene with its own values, one job, one row of the table."""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from soro_core._jit import compiling_once
from soro_core.config import find_config, load, with_changes
from soro_core.control.laws.registry import find_law
from soro_core.errors import ConfigError, SoroError
from soro_core.robot import Robot
from soro_core.twin.config import described_plant
from soro_lab.scene import Scene, check_gains, check_scene, load_scene, require_one_arm
from soro_ros.recordings import report
from soro_ros.recordings.verdict import judge
from soro_ros.run.end import End
from soro_ros.study.closed_loop import run_in_process, ticks_of, twin_of
from soro_ros.study.variations import StudyFile, robot_value

FIGURES = (
    "judged_s",
    "tip_error_first_rms_m",
    "tip_error_last_rms_m",
    "tip_error_last_max_m",
    "configured_tip_error_last_rms_m",
    "estimator_error_last_rms_m",
    "settling_s",
    "pressure_min_pa",
    "pressure_max_pa",
    "saturated_part",
    "saturated_last_part",
)
"""Columns of the table that the summary of `soro run` has too; behind them `verdict` and `reason`."""
COLUMNS = ("run", *FIGURES, "verdict", "reason")
# Names in that summary which are keys of a scene here.
_NAMES = {"judged_s": "duration_s"}
_NO_DEVICES = "none: faults of devices need soro run; without devices: payload, sensors, robot.* and plant.*"


@dataclass(frozen=True)
class StudyJob:
    """One run: its values by key, its scene with what the files say, and the true robot, if it differs.

    Such a scene names no file of a plant: a worker elsewhere does not have it.

    Without a scene it is refused, for the reason `refusal`.
    """

    number: int
    values: Mapping[str, Any]
    scene: Scene | None
    plant: Robot | None = None
    refusal: str = ""


class VariedScene:
    """A scene whose keys vary.

    Parameters
    ----------
    name : str
        File of the scene, or the name of a shipped one.
    changes : mapping of str to object
        Keys that are changed in all runs.
    file : str
        File with the variations.

    Raises
    ------
    ConfigError
        If the scene, the file, or one of its values is not allowed, or a fault needs devices.
    """

    def __init__(self, name: str, changes: Mapping[str, Any], file: str) -> None:
        self._name, self._changes = name, {**changes, "mode": "lockstep"}
        self.file = load(file, StudyFile)
        for key, one in self.file.vary.items():
            if key == "mode":
                raise ConfigError(file, "vary.mode", one.listed, "lockstep alone: a study has no deadlines")
            if key in COLUMNS:
                allowed = f"a key below it, as {key}.KEY: the table has another column of this name"
                raise ConfigError(file, f"vary.{key}", one.listed, allowed)
            if re.match(r"faults\b", key):
                raise ConfigError(file, f"vary.{key}", one.listed, _NO_DEVICES)
        self.scene = self._loaded({})
        self.described = [described(self.scene)]
        """What the files of the scene say, then those of each listed value."""
        # Not a draw, which may be refused as any other one.
        centre = {key: one.centre for key, one in self.file.vary.items()}
        self._check(centre)
        for key, one in self.file.vary.items():
            for value in one.listed:
                self._check({**centre, key: value})

    def jobs(self, known: Mapping[int, object]) -> Iterator[StudyJob]:
        """Yield the runs that are not known."""
        for number in range(self.file.runs):
            if number not in known:
                values = self.file.values(number)
                try:
                    yield self.job(number, values)
                except ConfigError as error:
                    yield StudyJob(number, values, None, refusal=str(error))

    def job(self, number: int, values: Mapping[str, Any]) -> StudyJob:
        """Return a run with values of `StudyFile.values`; raises ConfigError if one is not allowed."""
        scene, plant = self._varied(values)
        check_scene(scene, scene.name)
        check_gains(scene, scene.loaded_robot, scene.name)
        if plant is not None:
            scene = scene.with_keys(twin=with_changes(scene.twin, plant=""))
        return StudyJob(number, values, scene, plant)

    def _varied(self, values: Mapping[str, Any]) -> tuple[Scene, Robot | None]:
        """Return the scene with values, and the true robot, if it is another one."""
        kinds: dict[str, dict[str, tuple[str, Any]]] = {"": {}, "robot.": {}, "plant.": {}}
        for key, value in values.items():
            kind = key[:6] if key[:6] in kinds else ""
            kinds[kind][key.removeprefix(kind)] = (key, value)

        def of(robot: Robot, kind: str) -> Robot:
            paths = {p: self.file.scaled(*given, robot_value(robot, p)) for p, given in kinds[kind].items()}
            return robot.with_(paths) if paths else robot

        scene = self._loaded({k: self.file.scaled(*given, self._there(k)) for k, given in kinds[""].items()})
        if kinds["robot."]:
            scene = scene.with_robot(of(scene.loaded_robot, "robot."))
        if not (kinds["plant."] or scene.twin.plant):
            return scene, None
        return scene, of(described_plant(scene.loaded_robot, scene.twin_node()), "plant.")

    def _there(self, key: str) -> Any:
        value: Any = self.scene.to_dict()
        for part in key.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        return value

    def _loaded(self, changes: Mapping[str, Any]) -> Scene:
        scene = require_one_arm(load_scene(self._name, {**self._changes, **changes}), self._name)
        if scene.model is not None and scene.model.auto:
            from soro_lab.trade import with_chosen_model

            scene = with_chosen_model(scene, called=self._name)
        # Read here: a worker elsewhere does not have the files.
        scene.loaded_robot, scene.loaded_platform  # noqa: B018
        return scene

    def _check(self, values: Mapping[str, Any]) -> None:
        (scene, plant), where = self._varied(values), str(find_config(self._name, "scenes"))
        if scene.faults:
            raise ConfigError(where, "faults", ", ".join(map(str, scene.faults)), _NO_DEVICES)
        if scene.valves == "real":
            raise ConfigError(where, "valves", "real", "emulated: a study has no devices")
        check_scene(scene, where)
        check_gains(scene, scene.loaded_robot, where)
        twin_of(scene, plant)
        self.described.append(described(scene))


def described(scene: Scene) -> dict[str, Any]:
    """Return the keys of a scene and what the files say that it names, as plain values; of a law its hash."""
    law, platform = scene.controller.law, scene.loaded_platform
    files = {inspect.getfile(find_law(law)), *re.findall(r"(.+\.py):", law)}
    return scene.to_dict() | {
        "robot": scene.loaded_robot.model_dump(mode="json"),
        "platform": None if platform is None else platform.model_dump(mode="json"),
        "plant": described_plant(scene.loaded_robot, scene.twin_node()).model_dump(mode="json"),
        "law": sorted(hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in files),
    }


def row_of(job: StudyJob) -> dict[str, Any]:
    """Run a job; return its row: number, values, and figures and verdict as `soro run` has them."""
    row = {"run": job.number, **job.values, **dict.fromkeys(FIGURES)}
    if job.scene is None:
        return {**row, "verdict": "refused", "reason": job.refusal}
    recording = summary = None
    try:
        warm_up(job.scene, job.plant)
        recording, end = run_in_process(job.scene, job.plant)
        summary = report.summarise(recording, job.scene)
    except ConfigError as error:
        end = End(2, str(error))
    verdict = judge(summary, job.scene, end, recording)
    figures = {name: getattr(summary, _NAMES.get(name, name), math.nan) for name in FIGURES}
    row |= {name: value for name, value in figures.items() if math.isfinite(value)}
    return {**row, "verdict": verdict.word, "reason": verdict.reason}


_warmed: list[bool] = []


def warm_up(scene: Scene, plant: Robot | None = None) -> None:
    """Load or compile the kernels of the first run of this process, one process at a time."""
    if not _warmed:
        _warmed.append(True)
        with compiling_once(), contextlib.suppress(SoroError):  # the run itself says so
            list(islice(ticks_of(scene, plant), 4))
