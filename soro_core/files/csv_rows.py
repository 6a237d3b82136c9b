"""Rows of a CSV file as loggers and spreadsheets write it; a row that is damaged is left out and counted."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from soro_core.errors import ConfigError, short

ENDINGS = (".csv", ".tsv", ".txt", ".dat", ".asc")
"""Endings of the names of CSV files, in small letters."""

_COMMENTS = ("#", "%", "//")
# Spaces last: a sentence before the names may hold them as words.
_DELIMITERS = (",;\t|", " ")
# Lines in which the line of names is looked for, and over which one cell may go.
_HEAD, _LONGEST_CELL = 1000, 1000
# Names that need no quotes in a line of text.
_PLAIN = re.compile(r"[^\s,;:'\"]+")


class CsvRows:
    """Rows under the line of names of a CSV file; to be iterated once.

    The line of names is the first one that holds all names that are asked for, between commas, semicolons,
    tabs, bars or spaces; what stands before it is not read. Left out is a row that has not one cell for each
    name, that holds bytes 0 (a power cut leaves them), or at whose last number the file may have been cut.
    The latter is a last row without an end of line. It counts only if all rows have the same number of
    characters, one or more, behind the mark of their last number, as loggers with a fixed format write them.

    Parameters
    ----------
    path : path
        File in UTF-8, UTF-16 with its mark, or Latin-1.
    required : sequence of str
        Names that are asked for, one or more.
    asked_by : mapping of str to str, optional
        What asks for each, for errors.
    of_text : bool
        Whether cells are texts: they keep their spaces, may go over lines, and no row is a comment.

    Attributes
    ----------
    where : str
        The file.
    names : list of str
        Names of the columns.
    delimiter : str
        What divides cells.

    Raises
    ------
    ConfigError
        If the file cannot be read, or no line holds the names.
    """

    def __init__(
        self,
        path: str | Path,
        required: Sequence[str],
        asked_by: Mapping[str, str] | None = None,
        of_text: bool = False,
    ) -> None:
        self.where, self._of_text = str(path), of_text
        self._lines = _lines(path, required)
        self._begin, self.delimiter, self.names = self._find_names(required, asked_by or {})
        self._left_out, self._total, self._first = 0, 0, ""
        self._widths = set[int]()

    def place(self, name: str) -> int:
        """Return the number of the column of a name; ConfigError where two columns have it."""
        if self.names.count(name) > 1:
            allowed = "a name that one column has; rename the other in the file"
            got = f"{self.names.count(name)} columns of this name"
            raise ConfigError(self.where, quoted(name), got, allowed)
        return self.names.index(name)

    def __iter__(self) -> Iterator[tuple[int, list[str]]]:
        """Yield the number of the line and one cell for each name."""
        at = self._begin
        while at < len(self._lines):
            line, after = self._joined(at)
            number, at = at + 1, at + 1
            if not line.strip() or (line.lstrip().startswith(_COMMENTS) and not self._of_text):
                continue
            self._total += 1
            if "\0" in line:
                self.leave_out(number, "bytes 0")
                continue
            try:
                cells = _cells(line, self.delimiter, self._of_text)
            except csv.Error as error:
                self.leave_out(number, str(error))
                continue
            if not any(cells):
                self._total -= 1
                continue
            is_ended = line.endswith(("\n", "\r")) or len(cells) > len(self.names)
            while len(cells) > len(self.names) and not cells[-1].strip():
                cells.pop()
            if len(cells) != len(self.names):
                self.leave_out(number, f"{len(cells)} cells, where there are {len(self.names)} names")
                continue
            width = _decimals(cells[-1])
            if not is_ended and (width == 0 or self._widths != {width}):
                self.leave_out(number, f"the file ends at {short(cells[-1])}, which may be cut")
                continue
            self._widths.add(width)
            at = after
            yield number, cells

    def leave_out(self, number: int, why: str) -> None:
        """Count a row, by the number of its line, that cannot be used."""
        self._left_out += 1
        self._first = self._first or f"line {number}: {why}"

    def skip(self) -> None:
        """Do not count the row that was read last: it is part of the head."""
        self._total -= 1
        self._widths.clear()

    def check(self, least: int = 0) -> str:
        """Return what was left out, in one line, "" for nothing; at least so many rows must be left.

        Raises
        ------
        ConfigError
            If there are fewer, or more than half of all was left out.
        """
        good = self._total - self._left_out
        if self._left_out and good < max(least, self._left_out):
            line, _, why = self._first.partition(": ")
            allowed = f"rows that can be read, half or more of all (here {good} of {self._total})"
            raise ConfigError(self.where, line, why, allowed)
        if good < least:
            raise ConfigError(self.where, "", f"{good} rows", f"{least} or more rows under the line of names")
        if not self._left_out:
            return ""
        return f"{self._left_out} of {self._total} rows left out; the first is {self._first}"

    def _joined(self, at: int) -> tuple[str, int]:
        """Return a line, with those over which its last cell goes on, and where the next row begins."""
        line, after = _text(self._lines[at]), at + 1
        end = min(len(self._lines), at + _LONGEST_CELL)
        while self._of_text and line.count('"') % 2 and after < end:
            line, after = line + _text(self._lines[after]), after + 1
        return line, after

    def _find_names(self, required: Sequence[str], asked_by: Mapping[str, str]) -> tuple[int, str, list[str]]:
        """Return where the rows begin, the delimiter, and the names."""
        best: tuple[int, int, list[str]] = (-1, 0, [])
        for delimiters in _DELIMITERS:
            is_first = True
            for k, line in enumerate(self._lines[:_HEAD]):
                text = _text(line).strip()
                for mark in _COMMENTS:
                    text = text.removeprefix(mark).strip()
                for delimiter in delimiters if text else ():
                    names = _names(text, delimiter)
                    known = sum(name in names for name in required)
                    if known == len(required):
                        return k + 1, delimiter, names
                    # What an error shows: the line that has the most of them, else the first one.
                    best = max(best, (known, is_first * len(names), names), key=lambda found: found[:2])
                is_first = is_first and not text
        missing = next(name for name in required if name not in best[2])
        allowed = f"a column for {asked_by[missing]}" if missing in asked_by else "this column is required"
        raise ConfigError(self.where, quoted(missing), f"columns {quoted(*best[2])}", allowed)


def quoted(*names: str) -> str:
    """Return names of columns with commas between them; one with spaces, commas or the like has quotes."""
    return ", ".join(name if _PLAIN.fullmatch(name) else repr(name) for name in names)


def read_matrix(path: str | Path) -> list[list[float]]:
    """Return the rows of a CSV file of numbers alone, in any layout; each row counts.

    Raises
    ------
    ConfigError
        If the file cannot be read.
    ValueError
        With the line that is no row of numbers, or where there is none.
    """
    lines = [(k + 1, _text(line).strip()) for k, line in enumerate(_lines(path, ()))]
    lines = [(number, line) for number, line in lines if line and not line.startswith(_COMMENTS)]
    delimiter = next((d for d in "".join(_DELIMITERS) if lines and _is_row(lines[0][1], d)), ",")
    rows: list[list[float]] = []
    for number, line in lines:
        try:
            rows.append([number_of(cell, delimiter) for cell in _names(line, delimiter)])
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from None
        if len(rows[-1]) != len(rows[0]):
            raise ValueError(f"line {number}: {len(rows[-1])} numbers after rows of {len(rows[0])}")
    if not rows:
        raise ValueError("no row of numbers")
    return rows


def _is_row(line: str, delimiter: str) -> bool:
    try:
        return len([number_of(cell, delimiter) for cell in _names(line, delimiter)]) > 1
    except ValueError:
        return False


def _lines(path: str | Path, required: Sequence[str]) -> list[bytes]:
    """Return the lines of a file, in UTF-8 or as they are, with their ends."""
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        allowed = f"a CSV file with the columns {quoted(*required)}"
        raise ConfigError(str(path), "", "no such file", allowed) from None
    except (OSError, ValueError) as error:
        raise ConfigError(
            str(path), "", getattr(error, "strerror", None) or str(error), "a CSV file"
        ) from None
    if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise ConfigError(str(path), "", "a spreadsheet or an archive", "a CSV file; export it as one")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        data = data.decode("utf-16", errors="replace").encode()
    return data.removeprefix(b"\xef\xbb\xbf").splitlines(keepends=True)


def _text(line: bytes) -> str:
    try:
        return line.decode()
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _cells(line: str, delimiter: str, of_text: bool) -> list[str]:
    text = line.rstrip("\r\n") if of_text else line.strip(" \r\n")
    return next(csv.reader([text], delimiter=delimiter, skipinitialspace=not of_text, strict=of_text), [])


def _names(line: str, delimiter: str) -> list[str]:
    try:
        names = [name.strip() for name in _cells(line, delimiter, of_text=False)]
    except csv.Error:
        return []
    while names and not names[-1]:
        names.pop()
    return names


def _decimals(cell: str) -> int:
    """Number of characters behind the decimal mark, with those of an exponent."""
    return len(cell.strip().replace(",", ".").partition(".")[2])


# What loggers write where they have no reading.
_MISSING = frozenset(("", "na", "n/a", "#n/a", "null", "none", "-", "--"))


def number_of(cell: str, delimiter: str) -> float:
    """Return the number of a cell, with a decimal point or a decimal comma; nan of an empty one.

    Raises
    ------
    ValueError
        If it is none; of a comma between commas also where it may be a mark of thousands (``101,325``).
    """
    text = cell.strip()
    if text.lower() in _MISSING:
        return float("nan")
    whole, comma, behind = text.partition(",")
    is_thousands = (
        delimiter == "," and len(behind) == 3 and whole.lstrip("+-0") and len(whole.lstrip("+-")) < 4
    )
    if "_" not in text and not (comma and is_thousands):
        try:
            return float(f"{whole}.{behind}" if comma and "." not in text else text)
        except ValueError:
            pass
    raise ValueError(f"{short(cell)}, which is no number")
