"""`soro plot BAG`: pictures of a recorded run. `soro report BAG`: a page of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn, TypeAlias

import typer

from soro_core.errors import BagError, ConfigError, SoroError
from soro_core.extras import require
from soro_core.files.units import unit_option
from soro_lab.run_folder import run_folders
from soro_ros.commands.film import Rate, Width, write_film

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ENDINGS = (".png", ".svg", ".pdf")
Run: TypeAlias = Annotated[
    Path,
    typer.Argument(
        help="Folder of a run, of a bag, or an .mcap file.", show_default=False, autocompletion=run_folders
    ),
]
Start: TypeAlias = Annotated[
    float | None, unit_option("--start", "s", help="First time that is shown; default: the begin.")
]
End: TypeAlias = Annotated[
    float | None, unit_option("--end", "s", help="Last time that is shown; default: the end.")
]
Arm: TypeAlias = Annotated[
    str | None, typer.Option(metavar="NAMESPACE", help="The arm, if the bag has several.")
]
SceneFile: TypeAlias = Annotated[
    Path | None, typer.Option(help="Scene of the run; default: the one in its folder, if any.", exists=True)
]


def plot(
    run: Run,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic", "-t", metavar="NAME", help="Draw fields of this topic or pattern; repeatable."
        ),
    ] = None,
    field: Annotated[
        list[str] | None,
        typer.Option(
            "--field",
            "-f",
            metavar="PATH",
            help="Draw this field of the topics, or pattern: effort.*, pose.pose.position.x; repeatable.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="File to write: .png, .svg, .pdf. Default: plot.png in RUN."),
    ] = None,
    start: Start = None,
    end: End = None,
    arm: Arm = None,
    scene: SceneFile = None,
    film: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Instead: a film of the arm as it moves, .gif; .png holds its last picture."
        ),
    ] = None,
    rate: Rate = 10.0,
    width: Width = 800,
) -> None:
    """Draw a recorded run: pressures set and measured, tip, reference and error, strains, what was learned.

    Trips, warnings and injected faults are marked. With --topic or --field any number of any topic. A bag
    need not have all topics: what is missing is named. A film shows a simulated arm as it was, a real one as
    the estimator found it. Exit status 2: the bag cannot be read, or wrong use.
    """
    require("ros")
    from matplotlib import pyplot

    notes: list[str] = []
    file = (run if run.is_dir() else run.parent) / "plot.png" if out is None else out
    try:
        if film is not None:
            if topic or field or out or scene:
                others = "no other option than --arm, --start, --end, --rate and --width"
                raise ConfigError("soro plot", "--film", str(film), others)
            write_film(run, film, (start or 0.0, end), rate, width, arm)
            return
        if file.suffix not in _ENDINGS:
            raise ConfigError("soro plot", "--out", str(file), f"a name that ends with {', '.join(_ENDINGS)}")
        _check_folder("soro plot", file)
        if topic or field:
            figure = _chosen(run, topic or [], field or [], start, end, arm, scene, notes)
        else:
            figure = _all(run, start, end, arm, scene, notes)
    except (BagError, ConfigError) as error:
        _fail(error)
    _say(notes)
    figure.savefig(file, dpi=110)
    pyplot.close(figure)
    typer.echo(str(file))


def report(
    run: Run,
    out: Annotated[
        Path | None, typer.Option(help="Page to write, .html. Default: report.html in the folder of RUN.")
    ] = None,
    start: Start = None,
    end: End = None,
    arm: Arm = None,
    scene: SceneFile = None,
) -> None:
    """Write a page on a recorded run that opens without a network: one file with its pictures in it.

    Verdict, figures, pictures, events with their causes, what was recorded with its gaps, scene, versions.
    Exit status 2: the bag cannot be read, or wrong use.
    """
    require("ros")
    from soro_ros.pictures.run_page import page_of
    from soro_ros.pictures.run_view import open_run
    from soro_ros.recordings.recording import Spans

    file = (run if run.is_dir() else run.parent) / "report.html" if out is None else out
    try:
        if file.suffix != ".html":
            raise ConfigError("soro report", "--out", str(file), "a name that ends with .html")
        _check_folder("soro report", file)
        notes: list[str] = []
        spans = Spans()
        text = page_of(open_run(run, arm, scene, start, end, notes.append, spans), spans, notes).html
    except (BagError, ConfigError) as error:
        _fail(error)
    _say(notes)
    file.write_text(text, encoding="utf-8")
    typer.echo(f"{file}: {file.stat().st_size / 1e6:.2f} MB")


def _chosen(
    run: Path,
    topics: list[str],
    fields: list[str],
    start: float | None,
    end: float | None,
    arm: str | None,
    scene: Path | None,
    notes: list[str],
) -> Figure:
    from soro_ros.pictures.picture import picture_of_fields
    from soro_ros.pictures.run_view import open_run
    from soro_ros.recordings.selection import fields_of

    chosen = fields_of(run, topics, fields, notes.append)
    try:
        events = open_run(run, arm, scene).view.recording.events
    except (BagError, ConfigError):
        if arm is not None or scene is not None:
            raise
        events = ()  # a recording of no arm, or of several
    return picture_of_fields(chosen, start, end, events)


def _all(
    run: Path, start: float | None, end: float | None, arm: str | None, scene: Path | None, notes: list[str]
) -> Figure:
    from soro_ros.pictures import panels
    from soro_ros.pictures.picture import picture
    from soro_ros.pictures.run_view import open_run, title_of

    opened = open_run(run, arm, scene, start, end, notes.append)
    shown = []
    for panel in panels.panels_of(opened.view):
        if panel.known(opened.view):
            shown.append(panel)
        else:
            notes.append(f"left out: {panel.title}: not recorded: {panel.topics}")
    if not shown:
        raise BagError("nothing to draw: no topic of an arm has two messages", opened.reader.path, "missing")
    return picture(shown, opened.view, title_of(opened))


def _check_folder(command: str, file: Path) -> None:
    if not file.parent.is_dir():
        raise ConfigError(command, "--out", str(file), "a file in a folder that exists")


def _say(notes: list[str]) -> None:
    for line in notes:
        typer.echo(line, err=True)


def _fail(error: SoroError) -> NoReturn:
    typer.echo(f"soro: {error}", err=True)
    raise typer.Exit(2) from None
