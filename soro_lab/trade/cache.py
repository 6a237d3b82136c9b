"""Cache of results by the hash of robot, run, sources and machine."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from soro_core import _jit
from soro_lab.scene import Scene
from soro_lab.trade.candidate import Candidate
from soro_lab.trade.case import TradeCase

# Folders that results may depend on: the arm, its laws, its loop, and what scenes and studies say of them.
_PARTS = ("soro_core", "soro_lab/scene", "soro_lab/trade", "soro_lab/identification")


@lru_cache(maxsize=1)
def sources() -> str:
    """Return the hash of all source files that results depend on, and of the versions of numba and scipy."""
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256(f"{_jit.source_hash()} {scipy.__version__}".encode())
    for path in source_files(root):
        digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def source_files(root: Path) -> list[Path]:
    """Return the source files that results depend on; `root` holds the packages."""
    return [path for part in _PARTS for path in sorted((root / part).rglob("*.py"))]


class Cache:
    """A folder of small JSON files; a folder that cannot be used acts as an empty cache.

    Parameters
    ----------
    folder : Path, optional
        Folder; that in the user's cache by default.
    fresh : bool
        Ignore stored results, but store new ones.
    """

    def __init__(self, folder: Path | None = None, fresh: bool = False) -> None:
        self.folder = user_folder() if folder is None else folder
        self.fresh = fresh

    def get(self, key: str) -> dict[str, Any] | None:
        """Return the value stored under a key, or None."""
        if self.fresh:
            return None
        try:
            found = json.loads((self.folder / f"{key}.json").read_text())
        except (OSError, ValueError):
            return None
        return found if isinstance(found, dict) else None

    def put(self, key: str, value: dict[str, Any]) -> None:
        """Store a value; concurrent writers never leave a partial file."""
        path = self.folder / f"{key}.json"
        draft = path.with_suffix(f".{os.getpid()}")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            draft.write_text(json.dumps(value))
            draft.replace(path)
        except OSError:
            return


def user_folder() -> Path:
    """Return the folder of results in the user's cache, beside that of the kernels."""
    user = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(user) / "soro" / "trade"


def case_key(case: TradeCase) -> str:
    """Return the hash of a robot and a run, without the length of a tick."""
    arrays = b"".join(np.ascontiguousarray(a).tobytes() for a in (case.knots_s, case.pressure_pa))
    return _digest(
        robot=case.robot.model_dump(mode="json"),
        start=case.start and dict(case.start),
        pressures=hashlib.sha256(arrays).hexdigest(),
        t_end=case.t_end,
    )


def reference_key(case: str) -> str:
    """Return the key of the finest converged run so far."""
    return "reference-" + _digest(case=case)


def error_key(case: str, reference: str, candidate: Candidate) -> str:
    """Return the key of the errors of a candidate.

    Parameters
    ----------
    case, reference : str
    candidate : Candidate
        Discretisation, stepper and step.
    """
    return "error-" + _digest(case=case, reference=reference, candidate=candidate.section)


def cost_key(case: TradeCase, candidate: Candidate, repeats: int) -> str:
    """Return the key of the cost of a candidate on this machine.

    Parameters
    ----------
    case : TradeCase
        Run and length of a tick.
    candidate : Candidate
        Discretisation, stepper and step.
    repeats : int
        Repetitions of each time.
    """
    return "cost-" + _digest(
        case=case_key(case),
        tick=(case.tick_s, case.paced),
        machine=(platform.node(), platform.processor(), os.environ.get("NUMBA_DISABLE_JIT", "")),
        candidate=candidate.section,
        repeats=repeats,
    )


def loop_key(scene: Scene, **more: Any) -> str:
    """Return the key of a run of the closed loop."""
    return "loop-" + _digest(scene=_of_scene(scene), **more)


def choice_key(scene: Scene, robot: dict[str, Any], requirement: str) -> str:
    """Return the key of the model chosen for a scene and a requirement.

    Parameters
    ----------
    scene : Scene
    robot : dict
        Plain values of the robot.
    requirement : str
        Text of the requirement.
    """
    return "choice-" + _digest(
        scene=_of_scene(scene), robot=robot, requirement=requirement, machine=platform.node()
    )


def _of_scene(scene: Scene) -> dict[str, Any]:
    return scene.model_dump(mode="json", exclude={"model", "name", "recorder", "duration_s", "mode"})


def _digest(**parts: Any) -> str:
    text = json.dumps({"sources": sources(), **parts}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]
