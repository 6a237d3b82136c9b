"""`soro hil`: procedures on real regulators, and on emulated ones given as if they were real."""

from __future__ import annotations

import contextlib
import io
import itertools
import select
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soro_core.config import name_argument
from soro_core.files.units import Quantity, unit_option
from soro_hardware import signals
from soro_hardware.timing import punctual
from soro_lab.run_folder import new_folder
from soro_ros.host.findings_table import show, show_rows

if TYPE_CHECKING:
    import numpy as np

    from soro_core.robot import Robot
    from soro_hardware.platform import PlatformBase
    from soro_hardware.port import Regulator

app = typer.Typer(no_args_is_help=True)

_PLATFORM = name_argument("Platform file, or the name of a shipped one.", "platforms")
_DEVICE = typer.Option(help="Path or address in place of the platform's, as that of `soro emulate`.")
_LOCKSTEP = typer.Option("--lockstep", help="As fast as it goes, with `soro emulate --lockstep` only.")
_FOLDER = typer.Option(help="Where the folder of the report is made.")


@app.command("first-pressure")
def first_pressure(
    platform: Annotated[str, _PLATFORM],
    device: Annotated[str | None, _DEVICE] = None,
    robot: Annotated[
        str, typer.Option(help="Robot file or name: its model says how the arm must bend.")
    ] = "",
    pose: Annotated[
        str, typer.Option(help="Topic of the tip's measured pose (PoseStamped), with --robot.")
    ] = "",
    ask: Annotated[bool, typer.Option("--ask", help="Ask where the tip moved, with --robot.")] = False,
    steps: Annotated[str, typer.Option(help="Set points of each chamber, gauge.")] = "5,10,20kPa",
    hold: Annotated[
        float, unit_option("--hold", "s", 0.5, 600.0, "2s", help="Time for which each step is held.")
    ] = 2.0,
    rise: Annotated[
        float, unit_option("--rise", "Pa/s", 1e3, 200e3, "50kPa/s", help="Fastest rise of a set point.")
    ] = 50e3,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before each chamber.")] = False,
    lockstep: Annotated[bool, _LOCKSTEP] = False,
    folder: Annotated[Path, _FOLDER] = Path("runs"),
) -> None:
    """Pressurise PLATFORM for the first time: one chamber at a time, in small steps, each step judged.

    Looks at offset, sign, level, speed, leak, the other chambers, the way the arm bends, and the vent. A step
    that fails is the chamber's last. Everything passes the limiter, whose limits end just above the highest
    step. Ctrl-C vents. Ends with a table and a report in FOLDER; exit status 0 when every chamber was
    examined and nothing failed.
    """
    from soro_core.errors import ConfigError
    from soro_hardware.families import load_platform
    from soro_hardware.hil import report
    from soro_hardware.hil.paced import CycleSample, PacedRegulator, small_limits
    from soro_hardware.hil.plan import FirstPressureConfig, HilPlan
    from soro_hardware.hil.pressurise import expectation, pressurise

    if (pose or ask) and not robot:
        raise ConfigError("soro hil", "--robot", "", "a robot file or name, which --pose and --ask need")
    if robot and not (pose or ask):
        raise ConfigError("soro hil", "--robot", robot, "with --pose TOPIC or --ask, which say how it bends")
    if pose and ask:
        raise ConfigError("soro hil", "--ask", "--pose", "one of them: the pose answers what --ask asks")
    if ask and yes:
        raise ConfigError("soro hil", "--yes", "--ask", "one of them: --ask needs a person to answer")
    loaded = load_platform(platform)
    steps_pa = _steps_pa(steps, loaded.range.maximum_pa)
    config = FirstPressureConfig(steps_pa=steps_pa, hold_s=hold, rise_pa_s=rise)
    regulator = regulator_of(loaded, platform, device, lockstep)
    limits = small_limits(loaded, config.steps_pa[-1], config.rise_pa_s)
    expected = expectation(loaded, regulator.update_hz, config, _robot(robot))
    ways = expected.bending.directions() if ask and expected.bending is not None else ()
    plan = HilPlan(config, expected, confirm=not yes, directions=ways)
    samples: list[CycleSample] = []
    most, trip = limits.maximum_pa / 1e3, limits.over_pressure_pa / 1e3
    typer.echo(f"limits: set points up to {most:g} kPa, trip above {trip:g} kPa; Ctrl-C vents", err=True)
    # A Ctrl-C while nothing moves yet, at the wait for a first pose, ends it at once.
    with (
        _tip_of(pose) as tip,
        stop_of(loaded) as why_stopped,
        signals.noted() as stopped,
        contextlib.closing(regulator),
    ):
        regulator.configure()
        target = new_folder(folder, "first-pressure")  # refuse a read-only folder before any air flows
        guarded = PacedRegulator(loaded, regulator, limits, lockstep, tip, why_stopped=why_stopped)
        with punctual():
            state = pressurise(
                plan,
                guarded,
                samples.append,
                ask=show_question,
                answers=typed_answer,
                stopped=lambda: bool(stopped),
            )
    about = {**_about(platform, device or loaded.device), "robot": robot or "-"}
    title = f"First pressurisation of {platform}"
    show(title, state.findings)
    (target / "report.md").write_text(report.markdown(title, about, plan, state))
    (target / "report.json").write_text(report.first_pressure_json(about, plan, state))
    report.draw_first_pressure(target / "report.png", title, plan, samples)
    typer.echo(f"report: {target / 'report.md'}", err=True)
    raise typer.Exit(130 if stopped else 0 if report.verdict(state.findings) == "passed" else 1)


@app.command()
def latency(
    platform: Annotated[str, _PLATFORM],
    device: Annotated[str | None, _DEVICE] = None,
    low: Annotated[
        float, unit_option("--low", "Pa", 2e3, 500e3, "5kPa", help="Set point that steps begin from, gauge.")
    ] = 5e3,
    step: Annotated[float, unit_option("--step", "Pa", 1e3, 20e3, "4kPa", help="Height of a step.")] = 4e3,
    repeat: Annotated[
        int,
        typer.Option(
            min=2, max=200, help="Steps up, and as many down, of each chamber: twice as many are reported."
        ),
    ] = 10,
    hold: Annotated[float, unit_option("--hold", "s", 0.1, 20.0, "0.5s", help="Time between steps.")] = 0.5,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before the first pressure.")] = False,
    lockstep: Annotated[bool, _LOCKSTEP] = False,
    folder: Annotated[Path, _FOLDER] = Path("runs"),
) -> None:
    """Measure the latency of the loop on PLATFORM by small steps of one chamber at a time.

    From the set point sent: to readings exchanged, to the first that moves beyond its noise, to 63 %; dead
    time and lag by a fit of all steps, beside what the platform file says. Ctrl-C vents.
    """
    from soro_core.errors import HardwareError
    from soro_hardware.families import load_platform
    from soro_hardware.hil import report
    from soro_hardware.hil.latency import LatencyConfig, compare, evaluate
    from soro_hardware.hil.latency_run import latency_limits, measure
    from soro_hardware.hil.paced import PacedRegulator

    loaded = load_platform(platform)
    regulator = regulator_of(loaded, platform, device, lockstep)
    # A line that serves its chambers in turn needs some rounds for a step.
    config = LatencyConfig(
        low_pa=low,
        step_pa=step,
        repeat=repeat,
        hold_s=max(hold, 12 / regulator.update_hz),
    )
    limits = latency_limits(loaded, config)
    took_s = (2 * config.repeat + 4) * config.hold_s * regulator.n_chambers
    question = f"{limits.maximum_pa / 1e3:g} kPa in each chamber, one at a time, for {took_s:.0f} s: go on?"
    if not yes and not typer.confirm(question):
        raise typer.Exit(1)
    with stop_of(loaded) as why_stopped, signals.noted() as stopped, contextlib.closing(regulator):
        regulator.configure()
        target = new_folder(folder, "latency")  # refuse a read-only folder before any air flows
        guarded = PacedRegulator(loaded, regulator, limits, lockstep, why_stopped=why_stopped)
        with punctual():
            try:
                runs = measure(config, guarded, lambda: bool(stopped))
            except HardwareError as error:
                if not stopped:
                    raise
                typer.echo(f"soro: {error}", err=True)
                raise typer.Exit(130) from None
    found = evaluate(config, regulator.chamber_names, loaded.cycle_hz, runs)
    findings = compare(found, loaded.regulator, min(loaded.cycle_hz, regulator.update_hz))
    about, title = _about(platform, device or loaded.device), f"Latency of {platform}"
    show_rows(title, report.LATENCY_HEAD, report.latency_rows(found))
    typer.echo(
        f"set points sent to readings exchanged: {report.milliseconds(found.exchange)} ms p50 / p99 / max"
    )
    show("against the platform file", findings)
    (target / "report.md").write_text(report.latency_markdown(title, about, found, findings))
    (target / "report.json").write_text(report.latency_json(about, found))
    report.draw_latency(target / "report.png", title, found)
    typer.echo(f"report: {target / 'report.md'}", err=True)


def _about(platform: str, device: str | None) -> dict[str, str]:
    """Return the first lines of a report."""
    return {
        "platform": platform,
        "device": device or "",
        "time": time.strftime("%Y-%m-%d %H:%M:%S"),
    }


def regulator_of(
    platform: PlatformBase, name: str, device: str | None, lockstep: bool, command: str = "soro hil"
) -> Regulator:
    """Return the driver, which has opened nothing yet; refuse a platform without a device.

    Parameters
    ----------
    platform : PlatformBase
    name : str
        Its name on the command line.
    device : str or None
        Path or address in place of the platform's.
    lockstep : bool
        As in `open_regulator`.
    command : str
        Name of the command in errors.
    """
    from soro_core.errors import ConfigError
    from soro_hardware.families import open_regulator, require_driver

    require_driver(platform)
    if not (device or platform.device):
        allowed = f"the path or address of the devices, or the one that `soro emulate {name}` prints"
        raise ConfigError(command, "--device", "", allowed)
    return open_regulator(platform, device, lockstep=lockstep)


def _robot(name: str) -> Robot | None:
    from soro_core.robot import load_robot

    return load_robot(name) if name else None


def _steps_pa(text: str, most_pa: float) -> tuple[float, ...]:
    """Set points [Pa] of a list with commas."""
    from soro_core.errors import ConfigError

    steps = Quantity("Pa", 0.0, most_pa, "5,10,20kPa").read(text, "soro hil", "--steps")
    if not all(a < b for a, b in itertools.pairwise((0.0, *steps))):
        allowed = f"rising set points above 0, up to the platform's {most_pa / 1e3:g} kPa, like 5,10,20kPa"
        raise ConfigError("soro hil", "--steps", text, allowed)
    return steps


def _typed() -> bool:
    """Whether the standard input has a line to read."""
    with contextlib.suppress(io.UnsupportedOperation):
        return bool(select.select([sys.stdin], [], [], 0)[0])
    return False


def show_question(question: str) -> None:
    """Show a question and discard earlier input."""
    while _typed() and sys.stdin.readline():
        pass
    typer.echo(question, err=True)


def typed_answer() -> str | None:
    """Return a typed line without waiting; a closed input means no."""
    return (sys.stdin.readline() or "n") if _typed() else None


@contextlib.contextmanager
def stop_of(platform: PlatformBase) -> Iterator[Callable[[], str | None]]:
    """Give a function that tells why an emergency stop demands a vent; without its topic it needs no ROS."""
    if not platform.stop_topic:
        yield lambda: None
        return
    from soro_ros.topics.stop_topic import reading_stop

    with reading_stop(platform) as why_stopped:
        yield why_stopped


@contextlib.contextmanager
def _tip_of(topic: str) -> Iterator[Callable[[], np.ndarray | None]]:
    """Give a function for the newest position of the tip; without a topic it needs no ROS."""
    if not topic:
        yield lambda: None
        return
    from soro_ros.topics.pose_source import PoseSource

    with PoseSource(topic) as source:
        yield source.newest
