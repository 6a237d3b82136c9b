"""`soro bag info|repair|convert BAG`: show a recording, complete one, convert it to tables and back."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from soro_core.errors import ConfigError
from soro_lab.run_folder import run_folders

if TYPE_CHECKING:
    from soro_lab.bag import BagReader, PartRepair, Qos
    from soro_lab.bag.mcap.part import BagFile

app = typer.Typer(no_args_is_help=True)
BAG_HELP = "Folder of a bag (rosbag2) or of a run, or a single .mcap or .db3 file."
# Most topics, files, attachments, metadata records and own data that are shown.
_MOST_ROWS = 1000
Bag = Annotated[
    Path, typer.Argument(help=BAG_HELP, exists=True, show_default=False, autocompletion=run_folders)
]


@app.command("info")
def info(bag: Bag, full: Annotated[bool, typer.Option(help="Show the type hashes too.")] = False) -> None:
    """Show the content of BAG: files, times, and each topic with its type, messages and quality of service.

    Reads bags of soro and of rosbag2 alike. Of a bag that is damaged or was not closed it shows what can be
    read, and says what is missing.
    """
    # Imported here so that the other commands work without the extra `ros`.
    from soro_lab.bag import BagReader

    console = Console(markup=False)  # names in a bag may look like markup
    with BagReader(bag) as reader:
        _print_info(console, reader, full)


@app.command("repair")
def repair_command(bag: Bag) -> None:
    """Complete BAG after a crash: rewrite what is readable with an index, and metadata.yaml.

    Every message that can be read is kept with its bytes and times. Sound files stay untouched; where
    bytes had to be left out, the damaged file is kept beside the new one as NAME.damaged.
    """
    from soro_lab.bag import repair

    console = Console(markup=False)
    parts = repair(bag)
    for part in parts:
        _print_repair(console, part)
    if any(part.original for part in parts) and not any(part.message_count for part in parts):
        typer.echo(f"soro: {bag}: no message could be saved", err=True)
        raise typer.Exit(1)


@app.command("convert")
def convert(
    source: Annotated[
        Path,
        typer.Argument(help=f"{BAG_HELP} Or a folder with topics.yaml and CSV files.", show_default=False),
    ],
    target: Annotated[
        Path, typer.Argument(help="New folder: of the tables, or of the bag.", show_default=False)
    ],
    form: Annotated[
        str, typer.Option("--format", help="csv or parquet (extra: pip install 'soro[parquet]').")
    ] = "csv",
    topic: Annotated[
        list[str] | None,
        typer.Option("--topic", "-t", metavar="NAME", help="Only this topic, or pattern; repeatable."),
    ] = None,
) -> None:
    """Write a bag as one CSV or Parquet file a topic, or such CSV files as a bag.

    Messages are read by the definitions in the bag. A column is a value of the message by its path, with its
    unit where soro knows it: effort.link0/chamber0_pa. TARGET/topics.yaml says which file is which topic, of
    which type; for CSV files of your own, write it by hand. Messages come back as they were.
    """
    from soro_ros.recordings import convert as tables

    if form not in tables.FORMATS:
        raise ConfigError("soro bag convert", "--format", form, " or ".join(tables.FORMATS))
    if (source / tables.TOPICS).exists():
        count = tables.to_bag(source, target, lambda line: typer.echo(line, err=True))
        typer.echo(f"{target}: {count} messages")
        return
    rows = tables.to_tables(source, target, form, topic or [], lambda line: typer.echo(line, err=True))
    for file, count in rows.items():
        typer.echo(f"{target / file}: {count} rows")


def _print_info(console: Console, reader: BagReader, full: bool) -> None:
    from soro_lab.bag.topics import encoding

    seconds = (reader.end_ns - reader.start_ns) / 1e9
    about = Table.grid(padding=(0, 2))
    about.add_row("bag", str(reader.path))
    _add_rows(about, "files", [("file", _about(part)) for part in reader.parts])
    if reader.message_count:
        about.add_row("begin", _time(reader.start_ns))
        about.add_row("end", _time(reader.end_ns))
    about.add_row("duration", f"{seconds:.3f} s")
    about.add_row("messages", str(reader.message_count))
    if reader.metadata is not None:
        about.add_row("version", f"{reader.metadata.version}, ROS {reader.metadata.ros_distro or 'unknown'}")
        _add_rows(about, "own data", list(reader.metadata.custom_data.items()))
    attachments = [item for part in reader.parts for item in part.attachments]
    notes = [f"{item.name}: {_size(item.data_size)}, {item.media_type}" for item in attachments]
    _add_rows(about, "attachments", [("attachment", note) for note in notes])
    names = dict.fromkeys(name for part in reader.parts for name, _ in part.metadata if name != "rosbag2")
    _add_rows(about, "metadata", [("metadata", name) for name in names])
    console.print(about, soft_wrap=True)
    table = Table(box=None, header_style="bold", pad_edge=False)
    for heading in ("topic", "type", "quality of service", *(["type hash"] if full else [])):
        table.add_column(heading, overflow="fold")
    table.add_column("messages", justify="right")
    table.add_column("Hz", justify="right")
    for topic, count in list(zip(reader.topics, reader.counts, strict=True))[:_MOST_ROWS]:
        rate = f"{(count - 1) / seconds:.1f}" if count > 1 and seconds > 0 else ""
        type_hash = [_plain(topic.type_hash)] if full else []
        offers = ", ".join(dict.fromkeys(map(_qos, topic.qos)))
        kind = topic.type + (f" ({written})" if (written := encoding(topic)) else "")
        table.add_row(_plain(topic.name), _plain(kind), offers, *type_hash, str(count), rate)
    console.print(table)
    if len(reader.topics) > _MOST_ROWS:
        console.print(f"and {len(reader.topics) - _MOST_ROWS} more topics", highlight=False)
    for problem in reader.problems:
        console.print(_plain(problem), style="yellow", highlight=False, soft_wrap=True)
    if reader.problems and reader.message_count:
        console.print(f"'soro bag repair {reader.path}' completes it", highlight=False, soft_wrap=True)


def _about(part: BagFile) -> str:
    packed = f", {part.compression} chunks" if part.compression else ""
    return f"{part.path.name}: {_size(part.size)}, {part.message_count} messages{packed}"


def _add_rows(about: Table, what: str, rows: list[tuple[str, str]]) -> None:
    """Add rows of texts from a bag; of too many, say how many are left out."""
    for heading, value in rows[:_MOST_ROWS]:
        about.add_row(_plain(heading), _plain(value))
    if len(rows) > _MOST_ROWS:
        about.add_row("", f"and {len(rows) - _MOST_ROWS} more {what}")


def _print_repair(console: Console, part: PartRepair) -> None:
    if not part.rewritten:
        console.print(f"{part.path}: sound, {part.message_count} messages", highlight=False, soft_wrap=True)
        return
    for problem in part.problems:
        console.print(_plain(problem), style="yellow", highlight=False, soft_wrap=True)
    kept = f"; the damaged file is {part.original}" if part.original else ""
    text = f"{part.path}: rewritten, {part.message_count} messages{kept}"
    console.print(text, highlight=False, soft_wrap=True)


def _qos(qos: Qos) -> str:
    return f"{qos.reliability} {qos.durability}"


def _plain(text: str) -> str:
    """Return text of a bag without control characters of the terminal."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text)


def _time(nanoseconds: int) -> str:
    """A date where the time is one, else (simulated time) seconds."""
    seconds = nanoseconds / 1e9
    if seconds < 1e8:
        return f"{seconds:.3f} s"
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S.%f} UTC"


def _size(size: float) -> str:
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"
