"""`soro excite SCENE`: move an arm safely through pressures from which its parameters can be identified."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
import yaml
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn

from soro_core.errors import ConfigError, SoroError
from soro_core.files.units import Quantity, unit_option
from soro_hardware import signals
from soro_lab.scene import Scene, check_plant, require_one_arm
from soro_lab.scene.options import Change, Device, Folder, SceneName, Valves, changes_of
from soro_ros.commands.hil import show_question, typed_answer
from soro_ros.run.end import End
from soro_ros.run.execution import ROUND_S, Stall, execute, make_folder, prepare

if TYPE_CHECKING:
    from soro_lab.excitation.procedure import Excitation
    from soro_ros.run.compose import Run
    from soro_ros.run.supervisor import RunMonitor

_LENGTHS = Quantity("m", -10.0, 10.0, "60mm")
# The clock of a simulated arm ends so long after the excitation [s].
MARGIN_S = 1.0
VERDICTS = {0: "done", 1: "stopped", 2: "refused", 130: "interrupted"}


def excite(
    scene: SceneName,
    change: Change = None,
    valves: Valves = None,
    device: Device = None,
    arm: Annotated[
        str | None, typer.Option(help="simulated, or real: its sensors publish; no shadow runs beside it.")
    ] = None,
    folder: Folder = Path("runs"),
    stages: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Stages in order, with commas: singles (levels of one chamber at a time, up and down), "
            "pairs, together (all chambers of a link), creep (one level for long), steps (fast ones), sweeps "
            "(of rising frequency). Default: all. A rest is always the first; --release adds the last.",
        ),
    ] = None,
    levels: Annotated[
        int | None,
        typer.Option(help="Levels of one chamber up to the highest, closer at low ones. Default: 4."),
    ] = None,
    highest: Annotated[
        float | None,
        unit_option(
            "--max", "Pa", help="Highest set point, gauge. Default: that of limits, platform and robot."
        ),
    ] = None,
    duration: Annotated[
        float | None,
        unit_option(
            "--duration",
            "s",
            help="Longest time of all stages, to which the times of levels, steps and sweeps are scaled.",
        ),
    ] = None,
    hold: Annotated[
        float | None,
        unit_option(
            "--hold",
            "s",
            help="Time at a level, which ends sooner when the arm is still. Default: 1.35.",
        ),
    ] = None,
    sweep: Annotated[
        float | None,
        unit_option(
            "--sweep",
            "Hz",
            help="Frequency at the end of a sweep; the lag of the regulators lowers it. Default: 12.",
        ),
    ] = None,
    repeat: Annotated[int | None, typer.Option(help="Times that all stages are done. Default: 1.")] = None,
    box: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTHS",
            help="Box that the tip may not leave, 60mm: half its width about the tip at rest, or six lengths "
            "with commas, x,y,z lowest and x,y,z highest in the frame of the poses. Default: the length.",
        ),
    ] = None,
    bend: Annotated[
        float | None,
        unit_option(
            "--bend",
            "rad",
            help="Largest rotation of a sensor since the rest; above 180deg: no limit. Default: 149deg.",
        ),
    ] = None,
    release: Annotated[
        bool, typer.Option(help="At the end a person bends the real arm by hand and lets it go.")
    ] = False,
) -> None:
    """Excite the arm of a scene by safe pressures, and record what identifies it.

    The set points take the way of those of a controller: the same limits, the same vents. The excitation ends
    by itself and vents when the tip leaves its box, when a sensor turns too far or is silent, and before a
    level at which the model has no balance. Every key of the section `excite` of a scene can be changed with
    --set too, e.g. --set excite.sweep_s=8.

    Leaves FOLDER/NAME-TIME with bag, plan.yaml (the sections) and summary.json. Exit status 0: done; 1:
    stopped early, which the bag shows too; 2: wrong use, before anything moved; 130: Ctrl-C, which vents and
    closes the bag.
    """
    console = Console(stderr=True)
    with signals.noted() as interrupted:
        options = {
            "stages": None if stages is None else [one.strip() for one in stages.split(",")],
            "levels": levels,
            "maximum_pa": highest,
            "duration_s": duration,
            "hold_s": hold,
            "sweep_high_hz": sweep,
            "repeat": repeat,
            "motion.box_m": None if box is None else list(_LENGTHS.read(box, "soro excite", "--box")),
            "motion.bend_rad": bend,
            "release": release or None,
        }
        changes = changes_of("soro excite", change or [], valves, device, arm)
        changes |= {f"excite.{key}": value for key, value in options.items() if value is not None}
        loaded, where = prepare(scene, changes, _check, console)
        excitation = _excitation(loaded, where)
        loaded = loaded.with_keys(duration_s=_longest_s(excitation) + MARGIN_S)
        _say(excitation, console)
        target = make_folder(folder, loaded, where)
        _write_plan(target, excitation)
        watch = _Watch(excitation)
        from soro_ros.run.loop_nodes import excitation_loop

        end = execute(loaded, target, interrupted, console, excitation_loop(loaded), watch)
    _report(target, end, watch, console)
    raise typer.Exit(end.status)


def _check(scene: Scene, where: str) -> list[str]:
    """Refuse a scene that cannot be excited."""
    if not scene.recorder.enabled:
        raise ConfigError(where, "recorder.enabled", False, "true: the bag is the result")
    if scene.excite.release and scene.arm != "real":
        allowed = "false with arm: simulated, which a hand cannot bend; true with arm: real"
        raise ConfigError(where, "excite.release", True, allowed)
    check_plant(require_one_arm(scene, where), where)
    return []


def _excitation(scene: Scene, where: str) -> Excitation:
    from soro_lab.scene.excitation import excitation_of

    return excitation_of(scene.exciter_node(), scene.loaded_robot, scene.loaded_platform, where)


def _longest_s(excitation: Excitation) -> float:
    from soro_lab.excitation.procedure import VENT_S

    return excitation.plan.longest_s + VENT_S


def _say(excitation: Excitation, console: Console) -> None:
    """Show how long the excitation takes, and the warning of the model."""
    plan, warned = excitation.plan, excitation.warned
    console.print(f"{len(plan.sections)} sections, at most {_longest_s(excitation):.0f} s of arm time")
    if warned is not None:
        text = f"stops before section {warned.index + 1}: {warned.reason}"
        console.print(f"[yellow]{escape(text)}[/yellow]", soft_wrap=True)


def _write_plan(folder: Path, excitation: Excitation) -> None:
    rows = [
        {"stage": one.stage, "name": one.name, "longest_s": round(one.longest_s, 4)}
        for one in excitation.plan.sections
    ]
    (folder / "plan.yaml").write_text(yaml.safe_dump({"sections": rows}, sort_keys=False))


class _Watch:
    """Shows progress until the excitation is over.

    `values` are the last ones of its node, which come at the begin of each section and once a second;
    `time_s` is the time of the excitation.
    """

    def __init__(self, excitation: Excitation) -> None:
        self._longest_s = _longest_s(excitation)
        self.values: dict[str, str] = {}
        self.time_s = 0.0

    def __call__(self, run: Run, supervisor: RunMonitor, scene: Scene, console: Console) -> None:
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[left]}"))
        with Progress(*columns, console=console) as progress:
            task, stall, asked = progress.add_task(scene.name, total=self._longest_s, left=""), Stall(), False
            while self.values.get("phase") != "over":
                try:
                    supervisor.spin(ROUND_S)
                    run.check_nodes(supervisor, self._left_s)
                finally:
                    self._note(supervisor)
                stall.check(self.time_s)
                values, left_s = self.values, self._left_s
                text = escape(supervisor.status["exciter"].message)
                left = f"{left_s:.0f} s of arm time left"
                progress.update(task, completed=self._longest_s - left_s, description=text, left=left)
                if values.get("asks"):
                    if not asked:
                        show_question(values["asks"])
                        asked = True
                    elif typed_answer() is not None:
                        supervisor.call("exciter/answer")
        if reason := self.values.get("reason"):
            raise SoroError(f"stopped: {reason}")

    @property
    def _left_s(self) -> float:
        return float(self.values.get("left_s", self._longest_s))

    def _note(self, supervisor: RunMonitor) -> None:
        self.values = supervisor.values("exciter")
        self.time_s = float(self.values.get("time_s", 0.0))
        if self.values.get("phase") != "over":  # the clock of lockstep, 0 in real time, is ahead of them
            self.time_s = max(self.time_s, supervisor.clock_s)


def _report(folder: Path, end: End, watch: _Watch, console: Console) -> None:
    """Write and print the result."""
    values = watch.values
    verdict = VERDICTS[end.status]
    figures: dict[str, Any] = {
        "verdict": verdict,
        "reason": "; ".join(filter(None, (end.error, *end.warnings))),
    }
    if "phase" in values:
        whole = values["phase"] == "over" and not values["reason"]
        done, of = int(values["section"]) + whole, int(values["sections"])
        figures |= {
            "sections_done": done,
            "sections": of,
            "not_still": int(values["not_still"]),
            "duration_s": watch.time_s,
        }
        restless = f", {values['not_still']} levels ended before the arm was still"
        text = f"{verdict}: {done} of {of} sections in {figures['duration_s']:.1f} s"
        console.print(text + (restless if figures["not_still"] else ""))
    (folder / "summary.json").write_text(json.dumps(figures, indent=2))
    if (folder / "bag").exists():
        console.print(f"bag:     {folder / 'bag'}", soft_wrap=True)
