"""The report of `soro identify`: its options, its progress, its end."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soro_core.errors import ConfigError

if TYPE_CHECKING:
    from rich.console import Console

    from soro_core.jobs import Executor
    from soro_core.robot import Robot
    from soro_lab.identification.arm.stages import ArmIdentification


@dataclass(frozen=True)
class ReportOptions:
    """What was asked of the report.

    Attributes
    ----------
    folder : Path or None
        None for no report.
    profile : str or None
        Numbers whose profile is simulated, with commas; ``all``, ``none``; None for the default.
    """

    folder: Path | None
    profile: str | None

    def check(self, robot: Robot, force: bool) -> None:
        """Refuse a folder that exists, unless by force, and numbers that the robot does not have."""
        from soro_lab.identification.arm.cases.parameters import numbers_of

        if self.folder is None:
            if self.profile not in (None, "none"):
                raise ConfigError("soro identify", "--profile", self.profile, "together with --report")
            return
        if self.folder.exists() and not (force and self.folder.is_dir()):
            allowed = "a folder that does not exist, or --force"
            raise ConfigError("soro identify", "--report", str(self.folder), allowed)
        known = numbers_of(robot)
        odd = [name for name in self._named() if name not in known and not name.startswith("frame/")]
        if odd:
            raise ConfigError(
                "soro identify", "--profile", odd[0], f"all, none, {', '.join(known)}, frame/..."
            )

    def names(self, found: ArmIdentification) -> tuple[str, ...]:
        """Return the numbers whose profile is simulated: none after Ctrl-C."""
        from soro_lab.identification.arm.profiles import least_certain

        if found.interrupted:
            return ()
        if self.profile is None:
            return least_certain(found)
        return tuple(found.solution.values) if self.profile == "all" else self._named()

    def _named(self) -> tuple[str, ...]:
        if self.profile in (None, "all", "none"):
            return ()
        return tuple(name.strip() for name in str(self.profile).split(","))


def write(
    found: ArmIdentification,
    options: ReportOptions,
    accept: float,
    out: Path,
    console: Console,
    executor: Executor | None = None,
) -> tuple[Path, bool]:
    """Write the report; return its page, and whether Ctrl-C ended the profiles.

    Parameters
    ----------
    found : ArmIdentification
    options : ReportOptions
        With a folder.
    accept : float
        Largest RMS error on held-out sections, in ranges moved.
    out : Path
        The robot file.
    console : Console
    executor : Executor, optional
        Searches the profiles; default threads on all cores.
    """
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from soro_lab.identification.arm.profiles import profiles
    from soro_lab.identification.arm.report import ReportContent, write_report
    from soro_lab.identification.arm.robot_yaml import impossible

    assert options.folder is not None
    names = options.names(found)
    bar = Progress(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=console)
    with bar:
        task = bar.add_task("profiles", total=None)

        def show(stage: str, done: float) -> None:
            bar.update(task, description=f"{stage}: {100 * done:.0f} %")

        own, interrupted = profiles(found, names, show, executor)
        bar.update(task, description="report")
        result = ReportContent(found, accept, own, impossible(found), str(out))
        return write_report(result, options.folder), interrupted
