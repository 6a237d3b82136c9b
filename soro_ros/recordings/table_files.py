"""Files that take the rows of a table."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

from soro_ros.conversion.fields import Value

# Rows of a Parquet file that are written at once.
_GROUP = 10_000


class TableFile(Protocol):
    """A file that is being written; a context manager."""

    def __enter__(self) -> TableFile: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

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
