"""The runs of a study: each a scene with its own values, one job, one row of the table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from soro_core._jit import compiling_once
from soro_core.config import find_config, load
from soro_core.errors import ConfigError, SoroError
from soro_core.robot import Robot
from soro_lab.scene import Scene, check_gains, check_scene, load_scene
from soro_ros.recordings import report
from soro_ros.recordings.verdict import judge
from soro_ros.run.end import End
from soro_ros.study.closed_loop import plant_of, run_in_process, ticks_of
from soro_ros.study.variations import PLANT, ROBOT, StudyFile, robot_value, scene_value

FIGURES = (
    "duration_s",
    "tip_error_first_rms_m",
    "tip_error_last_rms_m",
    "tip_error_last_max_m",
    "estimator_error_last_rms_m",
    "settling_s",
    "pressure_min_pa",
    "pressure_max_pa",
    "saturated_part",
    "saturated_last_part",
)
"""Columns of the table that `soro run` has in its summary too; behind them `verdict` and `reason`."""
_WARM_TICKS = 4


@dataclass(frozen=True)
class StudyJob:
    """One run.

    Attributes
    ----------
    number : int
    values : mapping of str to object
        Of the keys that vary, as its row has them.
    scene : Scene or None
        With robot and platform; None where it is refused.
    plant : Robot or None
        The true robot; None for that of the scene.
    refusal : str
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
        self.where = str(find_config(name, "scenes"))
        self.file = load(file, StudyFile)
        for key, one in self.file.vary.items():
            if key == "faults" or key.startswith(("faults.", "faults[")):
                names = [fault.get("fault") for fault in _mappings(one.listed)]
                raise ConfigError(file, f"vary.{key}", ", ".join(map(str, names)), _NO_DEVICES)
            if key in _FIXED:
                raise ConfigError(file, f"vary.{key}", "a key that varies", _FIXED[key])
        self.scene = self._loaded({})
        if self.scene.faults:
            raise ConfigError(self.where, "faults", ", ".join(map(str, self.scene.faults)), _NO_DEVICES)
        if self.scene.valves == "real" or self.scene.arm == "real":
            raise ConfigError(self.where, "valves", "real", "emulated: a study has no devices")
        self._check(file)

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
        """Return a run with values of `StudyFile.values`.

        Raises
        ------
        ConfigError
            If one of them is not allowed.
        """
        of_robot, of_plant, of_scene = {}, {}, {}
        for key, value in values.items():
            if not key.startswith((ROBOT, PLANT)):
                of_scene[key] = self.file.scaled(key, value, lambda key: scene_value(self.scene, key))
        scene = self._loaded(of_scene)
        robot = scene.loaded_robot
        for key, value in values.items():
            if key.startswith(ROBOT):
                path = key.removeprefix(ROBOT)
                of_robot[path] = self.file.scaled(key, value, lambda _: robot_value(robot, path))  # noqa: B023
        if of_robot:
            scene = scene.with_robot(robot.with_(of_robot))
        if not any(key.startswith(PLANT) for key in values):
            return StudyJob(number, values, scene)
        plant = plant_of(scene)
        for key, value in values.items():
            if key.startswith(PLANT):
                path = key.removeprefix(PLANT)
                of_plant[path] = self.file.scaled(key, value, lambda _: robot_value(plant, path))  # noqa: B023
        return StudyJob(number, values, scene, plant.with_(of_plant))

    def _loaded(self, changes: Mapping[str, Any]) -> Scene:
        scene = load_scene(self._name, {**self._changes, **changes})
        if scene.model is not None and scene.model.auto:
            from soro_lab.trade import with_chosen_model

            scene = with_chosen_model(scene, called=self._name)
        # Read here: a worker elsewhere does not have the files.
        scene.loaded_robot, scene.loaded_platform  # noqa: B018
        return scene

    def _check(self, file: str) -> None:
        """Refuse the first run, and each value that is listed, or bounds what is drawn, beside it."""
        first = self.file.values(0)
        for key, one in (("", None), *self.file.vary.items()):
            for value in one.listed if one is not None else (None,):
                job = self.job(0, first if one is None else {**first, key: value})
                assert job.scene is not None
                try:
                    check_scene(job.scene, self.where)
                    check_gains(job.scene, job.scene.loaded_robot, self.where)
                except ConfigError as error:
                    allowed = f"{error.allowed} (with {key} {value})" if key else error.allowed
                    raise ConfigError(error.where, error.key, error.got, allowed) from None


_NO_DEVICES = "none: faults of devices need soro run; without devices: payload, sensors, robot.* and plant.*"
_FIXED = {
    "mode": "lockstep alone: a study has no deadlines",
    "valves": "emulated alone: a study has no devices",
    "device": "none: a study has no devices",
    "arm": "simulated alone: a study has no devices",
}


def _mappings(values: Any) -> Iterator[Mapping[str, Any]]:
    """Yield the mappings in values that may be lists."""
    for value in values if isinstance(values, list | tuple) else [values]:
        if isinstance(value, Mapping):
            yield value
        elif isinstance(value, list | tuple):
            yield from _mappings(value)


def row_of(job: StudyJob) -> dict[str, Any]:
    """Run a job; return its row: number, values, and figures and verdict as `soro run` has them."""
    figures: dict[str, Any] = dict.fromkeys(FIGURES)
    row = {"run": job.number, **job.values, **figures}
    if job.scene is None:
        return {**row, "verdict": "refused", "reason": job.refusal}
    try:
        check_scene(job.scene, "scene")
        check_gains(job.scene, job.scene.loaded_robot, "scene")
        _warm_up(job.scene)
        recording, end = run_in_process(job.scene, job.plant)
        summary = report.summarise(recording, job.scene)
    except ConfigError as error:
        recording, end, summary = None, End(2, str(error)), None
    verdict = judge(summary, job.scene, end, recording)
    if summary is not None:
        row |= {name: getattr(summary, name) for name in FIGURES}
    return {**row, "verdict": verdict.word, "reason": verdict.reason}


_warmed = False


def _warm_up(scene: Scene) -> None:
    """Load or compile the kernels of the first run of this process, one process at a time."""
    global _warmed
    if _warmed:
        return
    _warmed = True
    with compiling_once():
        try:
            for _, _ in zip(range(_WARM_TICKS), ticks_of(scene), strict=False):
                pass
        except SoroError:  # the run itself says so
            pass
