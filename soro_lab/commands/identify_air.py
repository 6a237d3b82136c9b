"""The part of `soro identify` and `soro fit pressures` that concerns air: what is printed and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from soro_core.errors import ConfigError
from soro_core.files.units import unit_option

if TYPE_CHECKING:
    from rich.console import Console

    from soro_lab.identification.recording import Recording
    from soro_lab.identification.regulators.stages import FoundRegulators

VOLUME = unit_option("--volume", "m3", 1e-9, 1.0, "30ml", help="Volume of a chamber with its tube.")
SUPPLY = unit_option("--supply", "Pa", 1e3, 1e7, "200kPa", help="Gauge pressure of the supply.")


def sources(robot: str, recordings: Sequence[Path]) -> tuple[str | None, list[Path]]:
    """Return robot file and recordings; without a robot the first argument is a recording."""
    from soro_core.files.csv_rows import ENDINGS

    first = Path(robot)
    if first.suffix.lower() in (*ENDINGS, ".mcap") or first.is_dir():
        return None, [first, *recordings]
    if not recordings:
        raise ConfigError("soro identify", "RECORDINGS", "none", "one or more bags or CSV files")
    return robot, list(recordings)


def print_regulators(found: FoundRegulators) -> None:
    """Print steps, and errors of all models."""
    from rich.console import Console
    from rich.table import Table

    from soro_lab.identification import regulator_fit as air

    typer.echo(str(found.steps))
    table = Table(*air.HEADER)
    for row in air.rows(found.fits):
        table.add_row(*row)
    Console().print(table)


@dataclass(frozen=True)
class AirStage:
    """Stages of air, after those of the arm; one that exists is not replaced without `force`.

    Attributes
    ----------
    robot_file : Path
        File of the arm, whose name that of the regulators follows.
    volume_m3, supply_pa : float
        Volume of a chamber with its tube, gauge pressure of the supply.
    accept : float
        Largest RMS error on held-out data, in % of the range moved.
    force : bool
        Whether a file is replaced.
    """

    robot_file: Path
    volume_m3: float
    supply_pa: float
    accept: float
    force: bool

    def __post_init__(self) -> None:
        if self.out.exists() and not self.force:
            allowed = "a file that does not exist, or --force"
            raise ConfigError("soro identify", "--out", str(self.out), allowed)

    @property
    def out(self) -> Path:
        """File of the regulators."""
        return self.robot_file.with_name(f"{self.robot_file.stem}_regulators.yaml")

    def run(self, recordings: Sequence[Recording], console: Console, required: bool = False) -> int:
        """Find, print and write what the recordings show; return the exit status.

        Parameters
        ----------
        recordings : sequence of Recording
            Cleaned.
        console : Console
            Where the progress is shown.
        required : bool
            Whether recordings that show nothing of air are refused.
        """
        from soro_lab.identification.regulators.leak import leak_text
        from soro_lab.identification.regulators.stages import AirOptions, find_air
        from soro_lab.identification.regulators.written import air_yaml, pump_text

        options = AirOptions(self.volume_m3, self.supply_pa)
        with console.status("regulators, pumps, leaks") as status:
            found = find_air(
                recordings, options, lambda stage, cost: status.update(f"{stage}: {cost:.4g}"), required
            )
        if not found:
            return 0
        if found.regulators is not None:
            print_regulators(found.regulators)
        for line in (*(pump_text(found.pump) if found.pump is not None else ()), *leak_text(found.leaks)):
            typer.echo(line)
        self.out.parent.mkdir(parents=True, exist_ok=True)
        self.out.write_text(air_yaml(found, [one.name for one in recordings]), encoding="utf-8")
        typer.echo(f"written: {self.out}")
        for name, share in found.shares().items():
            if share != share:
                typer.echo(
                    f"{name}: nothing could be held out of one run: the error on others is not known",
                    err=True,
                )
        wrong = found.unphysical()
        for name, share in found.poor(0.01 * self.accept).items():
            wrong.append(f"{name}: RMS error {100 * share:.3g} % of the range; allowed is {self.accept:g} %")
        for line in wrong:
            typer.echo(f"not accepted: {line}", err=True)
        return 1 if wrong else 0
