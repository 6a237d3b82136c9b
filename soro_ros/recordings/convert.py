"""A bag as one table a topic, CSV or Parquet, and CSV files as a bag.

``topics.yaml`` beside the tables says which file is which topic, of which type.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import yaml
from pydantic import Field
from rclpy.serialization import serialize_message

from soro_core.config import Strict, parse, read_yaml
from soro_core.errors import BagError, ConfigError
from soro_core.files.csv_rows import CsvRows, quoted
from soro_lab.bag import BagReader, BagWriter, Topic
from soro_lab.bag.topics import qos_from
from soro_ros.conversion.decoding import Messages
from soro_ros.conversion.fields import NAMED, Value, built
from soro_ros.conversion.interfaces import definition, message_class
from soro_ros.conversion.units import column_of, path_of
from soro_ros.recordings.tables import LOG_TIME, TopicTable

TOPICS = "topics.yaml"
FORMATS = ("csv", "parquet")


class TopicEntry(Strict):
    """One topic of topics.yaml."""

    file: str = Field(description="table of the topic, beside topics.yaml")
    type: str = Field(description="type of its messages, as sensor_msgs/msg/JointState")
    names: tuple[str, ...] = Field(
        (), strict=False, description="names of a JointState, which its columns have"
    )
    qos: str = Field("", description="quality of service that its publishers offered")


def to_tables(
    bag: Path, folder: Path, form: str, topics: Sequence[str], say: Callable[[str], None]
) -> dict[str, int]:
    """Write a bag as one table a topic.

    Parameters
    ----------
    bag : Path
    folder : Path
        New folder of the tables.
    form : str
        One of `FORMATS`.
    topics : sequence of str
        Names or patterns; empty: all.
    say : callable
        Takes a line for each topic that is left out.

    Returns
    -------
    dict of str to int
        Rows of each file.

    Raises
    ------
    BagError
        If the bag cannot be read, or has no such topic.
    """
    from soro_ros.recordings.tables import WRITERS

    rows: dict[str, int] = {}
    with BagReader(bag) as reader, ExitStack() as open_files:
        chosen = wanted(reader, topics)
        messages = Messages(reader, {topic.name: None for topic in chosen})
        left_out: list[str] = []
        tables = list(_tables(messages, chosen, left_out.append))
        if not tables and len(messages.refused) == 1:
            messages.need(messages.refused)
        for line in (*(f"the bag is damaged: {problem}" for problem in reader.problems), *left_out):
            say(line)
        if not tables:
            raise BagError("no topic can be read", bag, "format")
        _make(folder)
        entries: dict[str, Any] = {}
        for table in tables:
            file = f"{table.topic.strip('/').replace('/', '.')}.{form}"
            headings: dict[str, type[Value]] = {LOG_TIME: int, **table.headings()}
            writer = open_files.enter_context(WRITERS[form](folder / file, headings))
            topic = reader.topic(table.topic)
            entries[table.topic] = TopicEntry(
                file=file,
                type=topic.type,
                names=tuple(table.names or ()),
                qos=yaml.safe_dump([one.as_map() for one in topic.qos], default_flow_style=True).strip(),
            ).model_dump(exclude_defaults=True, mode="json")
            rows[file] = 0
            for item, message in messages([table.topic]):
                writer.write({LOG_TIME: item.log_time_ns, **table.row(message)})
                rows[file] += 1
        (folder / TOPICS).write_text(yaml.safe_dump(entries, sort_keys=False), encoding="utf-8")
    return rows


def to_bag(folder: Path, bag: Path, say: Callable[[str], None]) -> int:
    """Write the CSV files of a folder as a bag; return the number of messages.

    Parameters
    ----------
    folder : Path
        Of topics.yaml and the files that it names.
    bag : Path
        New folder.
    say : callable
        Takes a line for each file of which rows are left out.

    Raises
    ------
    ConfigError
        If topics.yaml or a file is wrong: naming file, line, column and what is allowed.
    BagError
        If the bag cannot be written.
    """
    data = read_yaml(folder / TOPICS)
    where = str(folder / TOPICS)
    entries: dict[str, TopicEntry] = {}
    for name, entry in data.items():
        if not isinstance(entry, dict):
            raise ConfigError(where, name, entry, "file and type")
        entries[name] = parse(entry, TopicEntry, f"{where}: {name}")
    messages = [item for name, entry in entries.items() for item in _read(folder, name, entry, say)]
    messages.sort(key=lambda item: item[0])
    with BagWriter(bag) as writer:
        for name, entry in entries.items():
            about = definition(entry.type)
            qos = qos_from(entry.qos, where)
            writer.add_topic(Topic(name, entry.type, about.text, about.encoding, about.type_hash, qos))
        for log_time_ns, name, content in messages:
            writer.write(name, content, log_time_ns)
    return len(messages)


def wanted(reader: BagReader, patterns: Sequence[str]) -> list[Topic]:
    """Return the topics of these names or patterns, all for none; raise BagError if one fits no topic."""
    for pattern in patterns:
        if not any(fnmatchcase(topic.name, pattern) for topic in reader.topics):
            reader.topic(pattern)  # names those that there are
    return [
        topic
        for topic in reader.topics
        if not patterns or any(fnmatchcase(topic.name, pattern) for pattern in patterns)
    ]


def _tables(messages: Messages, topics: Sequence[Topic], say: Callable[[str], None]) -> Iterator[TopicTable]:
    """Yield the table of each topic with its columns; say which topics or messages are left out."""
    for error in messages.refused.values():
        say(f"left out: {error}")
    for name in dict.fromkeys(topic.name for topic in topics if topic.name not in messages.refused):
        table = TopicTable(name)
        try:
            table.learn(message for _, message in messages([name]))
        except ValueError as error:
            say(f"left out: {name}: {error}")
            continue
        for line in messages.left_out:
            say(line)
        if table.columns or not messages.left_out:
            yield table


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise BagError("exists already; name a new folder", folder, "exists") from None
    except OSError as error:
        raise BagError(f"cannot be written: {error.strerror}", folder, "disk") from None


def _read(
    folder: Path, topic: str, entry: TopicEntry, say: Callable[[str], None]
) -> Iterator[tuple[int, str, bytes]]:
    """Yield log time [ns], topic and serialised message of each row that can be read."""
    where, kind = folder / entry.file, message_class(entry.type)
    if kind is None:
        raise ConfigError(str(folder / TOPICS), f"{topic}.type", entry.type, "a type that is installed")
    rows = CsvRows(where, (LOG_TIME,), of_text=True)
    paths = _paths(where, topic, rows.names, entry, kind)
    for line, cells in rows:
        try:
            yield _message(str(where), topic, cells, paths, entry, kind, rows.delimiter)
        except ConfigError as error:
            rows.leave_out(line, f"{error.key}: {error.got}".removeprefix(": "))
    if left_out := rows.check():
        say(f"{where}: {left_out}")


def _paths(where: Path, topic: str, headings: list[str], entry: TopicEntry, kind: type[Any]) -> list[str]:
    """Return the path of each column."""
    paths: list[str] = []
    for heading in headings:
        path = heading if heading == LOG_TIME else path_of(topic, heading)
        if not path:
            begins = (
                heading[:end] for end in range(len(heading), 0, -1) if heading[end : end + 1] in ("", "_")
            )
            known = next((begin for begin in begins if _is_value(begin, entry, kind)), heading)
            raise ConfigError(str(where), "column", heading, quoted(column_of(topic, known)))
        if path != LOG_TIME and not _is_value(path, entry, kind):
            allowed = f"a value of {entry.type}" + (f", of {quoted(*entry.names)}" if entry.names else "")
            raise ConfigError(str(where), "column", heading, allowed)
        if path in paths:
            raise ConfigError(str(where), "column", heading, "each column once")
        paths.append(path)
    return paths


def _is_value(path: str, entry: TopicEntry, kind: type[Any]) -> bool:
    """Whether a message has a value of this path."""
    try:
        built(kind, {path: "1"}, entry.names)
    except KeyError:
        return False
    except ValueError:  # an element that others come before, or a text
        return True
    return True


def _message(
    where: str,
    topic: str,
    cells: list[str],
    paths: list[str],
    entry: TopicEntry,
    kind: type[Any],
    delimiter: str,
) -> tuple[int, str, bytes]:
    values = dict(zip(paths, cells, strict=True))
    time_text = values.pop(LOG_TIME)
    if not time_text.isdigit() or int(time_text) >= 2**63:
        raise ConfigError(where, LOG_TIME, time_text, "nanoseconds, 0 to 2^63 - 1")
    given = {path: text for path, text in values.items() if text != ""}
    names = entry.names if any(path.partition(".")[0] in NAMED for path in given) else ()
    try:
        return int(time_text), topic, bytes(serialize_message(built(kind, given, names, delimiter)))
    except (ValueError, AssertionError, OverflowError) as error:  # a number outside its type
        raise ConfigError(where, "", str(error).splitlines()[0], f"a value of {entry.type}") from None
    except KeyError as error:
        raise ConfigError(where, str(error.args[0]), "", f"a value of {entry.type}") from None
