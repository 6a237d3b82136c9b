"""A recorded run, opened for pictures and reports: its bag, its scene if there is one, and what it shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from soro_core.errors import BagError, ConfigError
from soro_lab.bag import BagReader
from soro_lab.run_folder import bag_and_scene
from soro_lab.scene import Scene, load_scene
from soro_ros.pictures.panels import View
from soro_ros.recordings import report
from soro_ros.recordings.recording import RunRecording, Spans, arms, recorded


@dataclass(frozen=True)
class OpenRun:
    """A recorded run.

    Attributes
    ----------
    folder : Path
        Folder of the run, or of the bag where that is alone.
    reader : BagReader
        The bag, closed again: what it says of itself stays.
    arm : str
        Namespace of the arm; "" for none before its topics.
    scene : Scene or None
    scene_file : Path or None
    recording : RunRecording
        As the scene, if any, says what it was.
    view : View
    """

    folder: Path
    reader: BagReader
    arm: str
    scene: Scene | None
    scene_file: Path | None
    recording: RunRecording
    view: View


def open_run(
    run: Path,
    arm: str | None = None,
    scene_file: Path | None = None,
    begin_s: float | None = None,
    end_s: float | None = None,
    say: Callable[[str], None] = lambda line: None,
    spans: Spans | None = None,
) -> OpenRun:
    """Open a run or a bag.

    Parameters
    ----------
    run : Path
        Folder of a run, folder of a bag, or an MCAP file.
    arm : str, optional
        Namespace; by default that of the scene, or the only one in the bag.
    scene_file : Path, optional
        By default the one in the folder of the run.
    begin_s, end_s : float, optional
        Time [s] that is shown; by default all.
    say : callable
        Takes a line on what is damaged or left out.
    spans : Spans, optional
        Takes the times of every message.

    Raises
    ------
    BagError
        If the bag cannot be read, or has no arm.
    ConfigError
        If it has several arms and none is chosen.
    """
    scene, found = _scene(run, scene_file, say)
    with BagReader(run) as reader:
        chosen = _arm(reader, arm, scene)
        recording = recorded(reader, chosen, spans)
    if scene is not None:  # it may be one of another arm
        scene = next((one for one in scene.each if one.name == chosen), None)
    if scene is not None:
        recording = report.of_scene(recording, scene)
    for problem in recording.problems:
        say(problem)
    shown, kind = _with_a_tip(recording, scene)
    begin, end = _span(shown)
    begin, end = begin if begin_s is None else begin_s, end if end_s is None else end_s
    if not begin < end:
        if end_s is None:
            raise ConfigError(str(run), "--start", begin, f"less than the end, {end:.3f} s")
        raise ConfigError(str(run), "--end", end, f"more than the begin, {begin:.3f} s")
    folder = run if run.is_dir() else run.parent
    return OpenRun(folder, reader, chosen, scene, found, recording, View(shown, scene, begin, end, kind))


def title_of(run: OpenRun) -> str:
    """Return what a run was, in one line."""
    if run.scene is None:
        return f"{run.arm or 'arm'} in {run.reader.path}"
    return report.title_of(run.scene)


def _scene(run: Path, given: Path | None, say: Callable[[str], None]) -> tuple[Scene | None, Path | None]:
    try:
        file = given or bag_and_scene(run)[1]
    except BagError:
        say("no scene beside the bag: limits, verdict and injected faults are not known")
        return None, None
    try:
        return load_scene(str(file)), file
    except ConfigError as error:
        if given is not None:
            raise
        say(f"the scene cannot be used, and is left out: {error}")
        return None, file


def _arm(reader: BagReader, given: str | None, scene: Scene | None) -> str:
    known, bag = arms(reader), reader.path
    if not known:
        raise BagError("no topic of an arm: chambers/state, arm/tip, arm/state, ...", bag, "missing")
    if given is not None:
        wanted = given.strip("/")
        within = f"{scene.name}/{wanted}" if scene is not None and scene.arms else wanted
        for name in (wanted, within):
            if name in known:
                return name
        raise ConfigError(str(bag), "--arm", given, ", ".join(name or "''" for name in known))
    if scene is not None and scene.name in known:
        return scene.name
    if len(known) > 1:
        raise ConfigError(str(bag), "--arm", "nothing", f"one of {', '.join(known)}")
    return known[0]


def _with_a_tip(recording: RunRecording, scene: Scene | None) -> tuple[RunRecording, str]:
    """Return a recording with the best tip there is as the true one; and its kind."""
    if recording.true_tip.t.size:
        is_measured = scene is not None and scene.arm == "real"
        return recording, "measured" if is_measured else "true"
    if recording.measured_tip.t.size:
        return replace(recording, true_tip=recording.measured_tip), "measured"
    return replace(recording, true_tip=recording.estimated_tip), "estimated"


def _span(recording: RunRecording) -> tuple[float, float]:
    """First and last time of the loop's topics; what is before the first set point is left out."""
    series = (
        recording.command,
        recording.reading,
        recording.estimated_tip,
        recording.true_tip,
        recording.estimated_state,
        recording.true_state,
    )
    begins = [float(one.t[0]) for one in series if one.t.size]
    ends = [float(one.t[-1]) for one in series if one.t.size]
    begin = 0.0 if recording.wanted_tip.t.size else min(begins, default=0.0)
    return begin, max(ends, default=begin)
