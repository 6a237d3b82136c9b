"""The messages of a topic as the rows of a table, and the files that take them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from soro_ros.conversion.fields import Value, flat, is_joint_state
from soro_ros.conversion.units import column_of

LOG_TIME = "log_time_ns"
# A table with more columns is no table: an image, a point cloud.
MOST_COLUMNS = 2000


@dataclass
class TopicTable:
    """Columns of a topic, found in its messages.

    Attributes
    ----------
    topic : str
    columns : dict of str to type
        Type of each path, in the order of the columns.
    names : list of str or None
        Names that every JointState with values has; None where there are none, or several.
    """

    topic: str
    columns: dict[str, type[Value]] = field(default_factory=dict)
    names: list[str] | None = None

    def learn(self, messages: Iterable[Any]) -> None:
        """Find the columns of some messages.

        Raises
        ------
        ValueError
            If there are too many.
        """
        by_number: dict[str, type[Value]] = {}
        by_name: dict[str, type[Value]] = {}
        same = True
        for message in messages:
            same = same and is_joint_state(message)
            for path, value in flat(message, by_name=False).items():
                by_number.setdefault(path, type(value))
            if len(by_number) > MOST_COLUMNS:
                raise ValueError(f"more than {MOST_COLUMNS} values in a message")
            if same:
                same = self._same_names(message)
                by_name |= {p: type(v) for p, v in flat(message).items() if p not in by_name}
        if not same:
            self.names = None
        named = self.names is not None
        columns = by_name if named else by_number
        self.columns = {p: t for p, t in columns.items() if not (named and p.startswith("name."))}

    def row(self, message: Any) -> dict[str, Value]:
        """Return the values of a message by the name of their column."""
        values = flat(message, by_name=self.names is not None)
        return {column_of(self.topic, path): values[path] for path in self.columns if path in values}

    def headings(self) -> dict[str, type[Value]]:
        """Return the names of the columns with their types."""
        return {column_of(self.topic, path): kind for path, kind in self.columns.items()}

    def _same_names(self, message: Any) -> bool:
        """Whether names can be left to the headings: the same in all messages that have values."""
        lengths = {len(message.position), len(message.velocity), len(message.effort)} - {0}
        if not message.name:
            return not lengths
        if self.names is None and len(set(message.name)) == len(message.name):
            self.names = list(message.name)
        return list(message.name) == self.names and lengths == {len(self.names)}


# Rows of a Parquet file that are written at once.
_GROUP = 10_000


class TableFile(Protocol):
    """A file that is being written; a context manager."""

    def __enter__(self) -> TableFile: ...

    def __exit__(self, *error: object) -> None: ...

    def write(self, row: Mapping[str, Value]) -> None:
        """Append a row; a column without a value stays empty."""


class CsvFile:
    """CSV with one line of names. Numbers have every digit that they need.

    Parameters
    ----------
    path : Path
    headings : mapping of str to type
        Columns with their types.
    """

    def __init__(self, path: Path, headings: Mapping[str, type[Value]]) -> None:
        self._stream = path.open("x", newline="", encoding="utf-8")
        self._writer = csv.DictWriter(self._stream, list(headings), restval="", lineterminator="\n")
        self._writer.writeheader()

    def __enter__(self) -> CsvFile:
        return self

    def __exit__(self, *error: object) -> None:
        self._stream.close()

    def write(self, row: Mapping[str, Value]) -> None:
        """Append a row."""
        self._writer.writerow(row)


class ParquetFile:
    """Parquet with one column each; parameters as in `CsvFile`."""

    def __init__(self, path: Path, headings: Mapping[str, type[Value]]) -> None:
        import pyarrow
        import pyarrow.parquet

        kinds = {bool: pyarrow.bool_(), int: pyarrow.int64(), float: pyarrow.float64(), str: pyarrow.string()}
        self._schema = pyarrow.schema([(name, kinds[kind]) for name, kind in headings.items()])
        self._arrow, self._rows = pyarrow, list[Mapping[str, Value]]()
        self._writer: Any = pyarrow.parquet.ParquetWriter(path, self._schema)

    def __enter__(self) -> ParquetFile:
        return self

    def __exit__(self, *error: object) -> None:
        self._flush()
        self._writer.close()

    def write(self, row: Mapping[str, Value]) -> None:
        """Append a row."""
        self._rows.append(row)
        if len(self._rows) >= _GROUP:
            self._flush()

    def _flush(self) -> None:
        self._writer.write_table(self._arrow.Table.from_pylist(self._rows, schema=self._schema))
        self._rows.clear()


WRITERS: dict[str, Callable[[Path, Mapping[str, type[Value]]], TableFile]] = {
    "csv": CsvFile,
    "parquet": ParquetFile,
}
