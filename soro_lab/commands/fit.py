"""`soro fit`: parameters of models from recordings of your own hardware."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from soro_core.files.units import unit_option
from soro_lab.commands.identify_air import SUPPLY, VOLUME

app = typer.Typer(no_args_is_help=True)


@app.callback()
def _group() -> None:
    """Make `pressures` a subcommand, although it is the only one."""


@app.command()
def pressures(
    records: Annotated[
        list[Path],
        typer.Argument(
            help="CSV files with the columns t [s] and, for each line NAME, its set point pd_NAME and "
            "measured pressure pm_NAME [Pa gauge].",
            show_default=False,
        ),
    ],
    volume: Annotated[float, VOLUME] = 30e-6,
    supply: Annotated[float, SUPPLY] = 200e3,
    smallest: Annotated[
        float, unit_option("--smallest", "Pa", 100.0, 1e6, "10kPa", help="Smallest step that is used.")
    ] = 10e3,
    picture: Annotated[Path | None, typer.Option(help="Picture of the steps and models (PNG).")] = None,
) -> None:
    """Fit the models of regulators and valves to the step responses in RECORDS; see docs/air.md.

    Prints the found and the omitted steps, the errors of each model, also on runs outside the fit, and
    parameters to paste into a platform.
    """
    from rich.console import Console

    from soro_lab.commands.identify_air import print_regulators
    from soro_lab.identification import regulator_fit as air
    from soro_lab.identification.regulators.stages import AirOptions, find_regulators
    from soro_lab.identification.steps import StepLimits, read_pressures

    console = Console(stderr=True)
    options = AirOptions(volume, supply, StepLimits(change_pa=smallest))
    with console.status("regulators") as status:
        found = find_regulators(
            [read_pressures(path) for path in records], options, lambda stage, _: status.update(stage)
        )
    assert found is not None
    print_regulators(found)
    for fitted in found.fits[1:]:
        print(f"# {fitted.kind.name}, parameters for {'each line' if fitted.kind.each_line else 'all lines'}")
        print(air.yaml_text(fitted))
    if picture is not None:
        from soro_lab.identification.air_picture import draw

        draw(picture, found.steps.steps, [found.fits[0], *found.fits[-2:]])
        console.print(f"written: {picture}")
