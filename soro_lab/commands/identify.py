"""`soro identify`: the numbers of an arm from recordings of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soro_core.errors import BagError, ConfigError
from soro_core.files.units import Quantity, unit_option
from soro_lab.commands.identify_air import SUPPLY, VOLUME, AirStage, sources

if TYPE_CHECKING:
    from soro_core.robot import Robot
    from soro_lab.identification.recording import Recording


def identify(
    robot: Annotated[
        str,
        typer.Argument(
            help="Robot file whose geometry and masses hold; its other numbers are first guesses. Not "
            "needed where CSV files have pressures and no shape."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            help="Robot file to write (YAML); regulators, pumps and leaks go beside it, into "
            "NAME_regulators.yaml.",
            show_default=False,
        ),
    ],
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Bags (folders of runs or of bags, MCAP files) and CSV files.", show_default=False
        ),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            help="Column map of the CSV files: a YAML file, or the name of a shipped one. One for all, or "
            "one for each CSV file in their order.",
            show_default=False,
        ),
    ] = None,
    accept: Annotated[
        float,
        typer.Option(
            min=0.0, help="Largest RMS error on held-out sections, in % of the range moved; above it, exit 1."
        ),
    ] = 10.0,
    laws: Annotated[
        str | None,
        typer.Option(
            help="Laws that may be added, with commas: " + "hyper-elastic, area slope, saturating area, "
            "dead band, creep, slow creep, Dahl hysteresis, moment arms (of each chamber), swelling area; "
            "none for the linear law. Default: all but the last two."
        ),
    ] = None,
    step: Annotated[
        float | None,
        unit_option(
            "--step",
            "s",
            1e-4,
            0.05,
            help="Step of simulations of the last fit; others take twice that. Default: so long that "
            "stiffness is right to 0.3 %.",
        ),
    ] = None,
    constant: Annotated[
        bool,
        typer.Option(
            "--constant",
            help="Simulate strains that are constant along a link: faster, and stiffness becomes that of "
            "this model, a third below that of the link where only its frequency shows it.",
        ),
    ] = False,
    rate: Annotated[
        float,
        unit_option("--rate", "Hz", 1.0, 1e5, "100Hz", help="Most samples of each sensor that are compared."),
    ] = 100.0,
    starts: Annotated[int, typer.Option(min=1, help="Starts of the search at states at rest.")] = 3,
    seed: Annotated[int, typer.Option(help="Seed of these starts.")] = 1,
    volume: Annotated[float, VOLUME] = 30e-6,
    supply: Annotated[float, SUPPLY] = 200e3,
    hold_out: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of a recording that no fit sees, not even the last one; may be given again. "
            "Default: sections of all recordings choose the laws, then all data are fitted.",
            show_default=False,
        ),
    ] = None,
    known_load: Annotated[
        list[str] | None,
        typer.Option(
            metavar="RUN=MASS",
            help="Known mass at the tip during a recording, beside that of the robot file, like weight=20g; "
            "may be given again. It fixes the common scale of gains and stiffness.",
            show_default=False,
        ),
    ] = None,
    known_push: Annotated[
        list[str] | None,
        typer.Option(
            metavar="RUN=FORCE",
            help="Known force on the tip during a recording, along x, y, z of the world, like "
            "push=80mN,0mN,0mN: what a scale shows that the arm presses on, or pulls it. As --known-load.",
            show_default=False,
        ),
    ] = None,
    keep: Annotated[
        str | None,
        typer.Option(
            help="Numbers that stay as described, with commas: link0/k_e,link0/damping_e.",
            show_default=False,
        ),
    ] = None,
    learn_from: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN",
            help="Run folder of soro run, or its learned.yaml: what the law had learned of this robot is the "
            "first guess of gains, area slopes, stiffness and damping.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace --out and --report if they exist.")] = False,
    report: Annotated[
        Path | None,
        typer.Option(help="Folder for a page with pictures and numbers of the result.", show_default=False),
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option(
            help="Numbers whose profile in the report is simulated, with commas; all; or none. "
            "Default: the three least certain."
        ),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Simulations at a time, in threads; default one a core.")
    ] = None,
    dask: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Simulate on this Dask cluster (extra: dask).")
    ] = "",
) -> None:
    """Find stiffness, damping, gains and laws of an arm, and its regulators, from recordings; write files.

    The file has the deviation and the origin of each number. Some sections of every recording are held out:
    they choose the laws, and their error is the one that counts. Exit status: 0 found and accepted; 1 not
    accepted (the error is above --accept, nothing could be held out, or a number is unphysical), the file is
    written and says why; 2 wrong use or data, nothing is written; 130 after Ctrl-C, the file has the best so
    far. See docs/identification.md.
    """
    from rich.console import Console

    from soro_core.adaptation.kept import kept_file, load_kept
    from soro_core.jobs import Threads, executor_of
    from soro_core.robot import load_robot
    from soro_lab.commands.identify_report import ReportOptions, write
    from soro_lab.commands.search_progress import SearchProgress
    from soro_lab.identification.arm.cases.physical import check_described
    from soro_lab.identification.arm.laws import LAWS, NAMED
    from soro_lab.identification.arm.learned_start import with_learned
    from soro_lab.identification.arm.report.verdict import is_accepted, sentence
    from soro_lab.identification.arm.robot_yaml import impossible, number_table, robot_text
    from soro_lab.identification.arm.stages import IdentificationOptions
    from soro_lab.identification.arm.stages import identify as search
    from soro_lab.identification.recording import check_motion, summary

    if out.exists() and not force:
        raise ConfigError("soro identify", "--out", str(out), "a file that does not exist, or --force")
    if out.suffix not in (".yaml", ".yml"):
        raise ConfigError("soro identify", "--out", str(out), "a name that ends with .yaml")
    names = [law.name for law in LAWS] if laws is None else [name.strip() for name in laws.split(",")]
    if names == ["none"]:
        names = []
    known = (*LAWS, *NAMED)
    odd = [name for name in names if name not in {law.name for law in known}]
    if odd:
        raise ConfigError("soro identify", "--laws", odd[0], ", ".join(law.name for law in known))
    name, paths = sources(robot, recordings or [])
    described = None if name is None else load_robot(name)
    wanted = ReportOptions(report, profile)
    if described is not None:
        if known_push and described.wrench_places:
            allowed = "none beside --known-push, which acts on the tip"
            raise ConfigError(str(name), "wrench_places", list(described.wrench_places), allowed)
        check_described(described, str(name))
        if learn_from is not None:
            described = with_learned(described, load_kept(learn_from), str(kept_file(learn_from)))
        wanted.check(described, force)
    console = Console(stderr=True)
    air = AirStage(out, volume, supply, accept, force)
    read = _loaded(_read(paths, columns or [], described), known_load or [], known_push or [])
    for recording in read:
        console.print(summary(recording), highlight=False, markup=False)
    if described is None or not any(recording.shapes for recording in read):
        for option, stated in (("--known-load", known_load), ("--known-push", known_push)):
            if stated:
                allowed = "none for the air alone; else a robot, and recordings of its shape"
                raise ConfigError("soro identify", option, stated[0], allowed)
        try:
            status = air.run(read, console, required=True)
        except ConfigError:
            if described is None:
                raise
            text = "no stream that shows the arm, and no steps of its regulators"
            allowed = "pose sensors or IMUs with orientations, or set points and pressures"
            raise ConfigError(str(paths[0]), "sensors/pose0", text, allowed) from None
        raise typer.Exit(status)
    check_motion(read)
    options = IdentificationOptions(
        dt_s=step,
        rate_hz=rate,
        laws=tuple(law for law in known if law.name in names),
        is_constant=constant,
        starts=starts,
        seed=seed,
        hold_out=tuple(hold_out or ()),
        keep=tuple(name.strip() for name in keep.split(",")) if keep else (),
    )
    try:  # before the search, which takes minutes
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError("soro identify", "--out", str(out), f"a folder to write to: {error}") from None
    with executor_of(jobs, dask, Threads) as executor, SearchProgress(console, len(options.laws)) as progress:
        found = search(described, read, replace(options, executor=executor), progress.show)
    if found.choice is not None:
        for trial in found.choice.tried:
            mark = "*" if trial is found.choice.chosen else " "
            typer.echo(f"{mark} {100 * trial.error:6.2f} % of the range, held out: {trial.name}")
    for what, those in (("fitted", found.fitted), ("held out", found.held_out)):
        for fit in those:
            typer.echo(f"  {what}: {fit}")
    typer.echo("\n".join(number_table(found)))
    out.write_text(robot_text(found, [path.name for path in paths]), encoding="utf-8")
    typer.echo(f"written: {out}")
    interrupted = found.interrupted
    status = 0 if interrupted else air.run(read, console)
    if wanted.folder is not None:
        with executor_of(jobs, dask, Threads) as executor:
            page, was_ended = write(found, wanted, 0.01 * accept, out, console, executor)
        interrupted = interrupted or was_ended
        typer.echo(f"written: {page}")
    unphysical = impossible(found)
    accepted = is_accepted(found, 0.01 * accept, unphysical)
    if interrupted and not found.interrupted:
        typer.echo("interrupted: the report lacks profiles", err=True)
    typer.echo(sentence(found, 0.01 * accept, unphysical), err=not accepted)
    status = status if accepted else 1
    if interrupted or status:
        raise typer.Exit(130 if interrupted else status)


def _loaded(recordings: list[Recording], loads: list[str], pushes: list[str]) -> list[Recording]:
    """Return the recordings with what `--known-load` and `--known-push` state."""
    found = {recording.name: recording for recording in recordings}

    def stated(option: str, text: str, kind: str) -> tuple[str, str]:
        name, _, value = text.partition("=")
        if name not in found:
            allowed = f"RUN={kind} with a recording: {', '.join(found)}"
            raise ConfigError("soro identify", option, text, allowed)
        return name, value

    for text in loads:
        name, value = stated("--known-load", text, "MASS")
        mass = Quantity("kg", 1e-4, 5.0, "20g").number(value, "soro identify", "--known-load")
        found[name] = replace(found[name], load_kg=mass)
    for text in pushes:
        name, value = stated("--known-push", text, "FORCE")
        push = Quantity("N", -100.0, 100.0, "80mN,0,0").read(value, "soro identify", "--known-push")
        if len(push) != 3 or not any(push):
            allowed = "three numbers, not all 0, like push=80mN,0mN,0mN"
            raise ConfigError("soro identify", "--known-push", text, allowed)
        found[name] = replace(found[name], push_n=(push[0], push[1], push[2]))
    return list(found.values())


def _read(paths: list[Path], columns: list[str], robot: Robot | None) -> list[Recording]:
    from soro_core.files.csv_rows import ENDINGS
    from soro_lab.identification.recording import read_bag, read_csv

    tables = [path for path in paths if path.suffix.lower() in ENDINGS]
    if tables and len(columns) not in (1, len(tables)):
        allowed = "one column map, or one for each CSV file"
        raise ConfigError("soro identify", "--columns", f"{len(columns)} for {len(tables)} files", allowed)
    maps = dict(zip(tables, columns * len(tables) if len(columns) == 1 else columns, strict=False))
    found = []
    for path in paths:
        if path not in maps and robot is None:
            raise ConfigError(
                "soro identify", "ROBOT", str(path), "a robot file, which names chambers, before a bag"
            )
        try:
            found.append(read_csv(path, maps[path], robot) if path in maps else read_bag(path, robot))  # type: ignore[arg-type]
        except BagError as error:  # a bag that cannot be read is wrong use, as a table is
            typer.echo(f"soro: {error}", err=True)
            raise typer.Exit(2) from None
    return found
