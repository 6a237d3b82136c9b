"""The runs of an arm in their order, each with its model error, stiffness and learned numbers."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from soro_core.adaptation.kept import FILE as LEARNED
from soro_core.adaptation.kept import load_kept
from soro_core.errors import SoroError
from soro_ros.ageing.model_error import FILE, ModelMismatch, keep_model_error

_FOLDER = re.compile(r"(?P<arm>.+)-(?P<when>\d{8}-\d{6})(-\d+)?")
_JUDGED = ("good", "poor")


@dataclass(frozen=True)
class RunEntry:
    """One run.

    Attributes
    ----------
    folder : Path
    when : datetime
        Of its begin, local time, as its name has it.
    word : str
        Verdict.
    error : ModelMismatch or None
        None where it cannot be known.
    digest : str
        Of the robot file and of how the model divides it; empty where nothing was learned.
    learned : mapping of str to tuple
        Value and deviation of each learned number.
    """

    folder: Path
    when: datetime
    word: str
    error: ModelMismatch | None
    digest: str
    learned: Mapping[str, tuple[float, float]]


def runs_of(arm: str, folder: Path, progress: Callable[[Path], object] = lambda path: None) -> list[RunEntry]:
    """Return the runs of an arm that were judged good or poor, the newest last.

    The error of the model of a run that has none yet is computed from its bag, and kept in its folder.

    Parameters
    ----------
    arm : str
        Name of its scene.
    folder : Path
    progress : callable
        Called with the folder of each run whose bag is read.
    """
    found = []
    for run in sorted(folder.glob(f"{arm}-*/")):
        name = _FOLDER.fullmatch(run.name)
        word = str(_json(run / "summary.json").get("verdict", ""))
        if name is None or name["arm"] != arm or word not in _JUDGED:
            continue
        digest, learned = _learned(run)
        when = datetime.strptime(name["when"], "%Y%m%d-%H%M%S")
        found.append(RunEntry(run, when, word, _error(run, progress), digest, learned))
    return sorted(found, key=lambda entry: entry.when)


def since_identified(runs: Sequence[RunEntry]) -> list[RunEntry]:
    """Return the last runs, all with the robot file of the newest one."""
    digest = next((run.digest for run in reversed(runs) if run.digest), "")
    first = max((k + 1 for k, run in enumerate(runs) if run.digest not in ("", digest)), default=0)
    return list(runs[first:])


def _learned(run: Path) -> tuple[str, dict[str, tuple[float, float]]]:
    if not (run / LEARNED).is_file():
        return "", {}
    try:
        kept = load_kept(run)
    except SoroError:  # of another version
        return "", {}
    return kept.digest, {name: (pair[0], pair[1]) for name, pair in kept.numbers.items()}


def _error(run: Path, progress: Callable[[Path], object]) -> ModelMismatch | None:
    if (run / FILE).is_file():
        written = _json(run / FILE)
        return (
            ModelMismatch(**written) if written.keys() == ModelMismatch.__dataclass_fields__.keys() else None
        )
    if not (run / "bag").is_dir():
        return None
    from soro_lab.run_folder import bag_and_scene
    from soro_lab.scene import load_scene
    from soro_ros.recordings.report import read_run

    progress(run)
    try:
        bag, scene_file = bag_and_scene(run)
        scene = load_scene(scene_file)
        return keep_model_error(run, read_run(bag, scene), scene)
    except (SoroError, OSError, ModuleNotFoundError):  # damaged, or read where there is no ROS
        return None


def _json(path: Path) -> dict[str, Any]:
    """Return what a file has, nothing where there is none."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
