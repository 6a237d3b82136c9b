"""What the law of a recorded run had learned at its end, in a file that the next run can start from."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from soro_core.adaptation.kept import FILE, keep
from soro_core.control.laws.registry import find_law
from soro_lab.scene import Scene
from soro_ros.recordings.recording import RunRecording, TopicSeries
from soro_ros.recordings.report import within


def keep_learned(folder: Path, recording: RunRecording, scene: Scene) -> Path | None:
    """Write what was learned into the folder of a run.

    Parameters
    ----------
    folder : Path
    recording : RunRecording
    scene : Scene

    Returns
    -------
    Path or None
        The file; None where nothing was learned, its recording has none of it, or no run of the law can
        start from it.
    """
    law = find_law(scene.controller.law)
    if not (law.learns and scene.controller.adapt and "learned" in law.Options.model_fields):
        return None
    found = recording.estimates, recording.deviations
    values, deviations = (_last(within(series, scene.duration_s)) for series in found)
    is_finite = np.isfinite([*values.values(), *deviations.values()]).all()
    if not values or values.keys() != deviations.keys() or not is_finite:
        return None
    kept = keep(scene.discretisation.discretise(scene.loaded_robot), values, deviations)
    (folder / FILE).write_text(kept.to_yaml(), encoding="utf-8")
    return folder / FILE


def _last(series: TopicSeries) -> dict[str, float]:
    """Return the last values of a series by name."""
    return dict(zip(series.names, series.value[-1].tolist(), strict=True)) if series.t.size else {}
