"""CSV files as loggers and spreadsheets write them give the same numbers, and damage costs its row."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
from made_recordings import CHAMBERS, robot

from soro_core.config import parse
from soro_core.errors import ConfigError
from soro_core.files.csv_rows import read_matrix
from soro_lab.identification import read_pressures
from soro_lab.identification.recording import Columns, read_csv, summary
from soro_lab.identification.records import read_columns, read_table
from tests.refused import fails

CASES = Path(__file__).parents[4] / "shared/data/outside_cases"
N = 40
NAMES = ["t", "pa (kPa)", "pb", "angle"]
MAP = parse(
    {
        "pressures": {"unit": "kPa", "columns": {CHAMBERS[0]: "pa (kPa)", CHAMBERS[1]: "pb"}},
        "bends": {"bent": {"column": "angle", "unit": "deg", "towards": "y"}},
    },
    Columns,
    where="map.yaml",
)


def values() -> np.ndarray:
    k = np.arange(N)
    return np.column_stack([0.1 * k, 20.25 + 0.5 * np.sin(k), 10.5 + 0.25 * np.cos(k), -3.0 + 0.5 * k])


def lines(delimiter: str = ",", names: list[str] = NAMES) -> list[str]:
    return [delimiter.join(names), *(delimiter.join(f"{value:.6f}" for value in row) for row in values())]


def plain() -> str:
    return "\n".join(lines()) + "\n"


def commas(delimiter: str) -> str:
    return "\n".join(line.replace(".", ",") for line in lines(delimiter)) + "\n"


def read(folder: Path, content: str | bytes):
    path = folder / "run.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_csv(path, MAP, robot())


def same(found, rows=slice(None)) -> None:
    table = values()[np.arange(N)[rows]]
    np.testing.assert_allclose(found.pressure.t, table[:, 0], atol=1e-6)
    np.testing.assert_allclose(found.pressure.values, 1e3 * table[:, 1:3], atol=1e-2)
    np.testing.assert_allclose(found.bends[0].angle, np.radians(table[:, 3]), atol=1e-6)


LAYOUTS = {
    "semicolons": "\n".join(lines(";")) + "\n",
    "decimal commas": commas(";"),
    "tabs": "\n".join(lines("\t")) + "\n",
    "tabs and decimal commas": commas("\t"),
    "bars": "\n".join(lines("|")) + "\n",
    "quoted names": plain().replace("t,pa (kPa),pb,angle", '"t","pa (kPa)","pb","angle"'),
    "quoted cells": "\n".join(",".join(f'"{c}"' for c in line.split(",")) for line in lines()) + "\n",
    "quoted decimal commas": "\n".join(
        ",".join('"' + c.replace(".", ",") + '"' for c in line.split(",")) for line in lines()
    ),
    "lines before the names": "logger,2026-01-01\nsettings: {'a': [1, 2], \"b\": 3}\n\nt\n" + plain(),
    "comments": "# a logger\n% of a lab\n" + plain().replace("\n3.0", "\n# paused\n3.0"),
    "names in a comment": "# a logger\n# " + plain(),
    "a line of units": plain().replace("\n0.0", "\ns,kPa,kPa,deg\n0.0", 1),
    "a mark of UTF-8": "\N{BYTE ORDER MARK}" + plain(),
    "UTF-16": plain().encode("utf-16"),
    "ends of Windows": plain().replace("\n", "\r\n"),
    "ends of old ones": plain().replace("\n", "\r"),
    "a delimiter at the end": plain().replace("\n", ",\n"),
    "a delimiter at the end of rows": plain().replace("\n", ",\n").replace("angle,", "angle"),
    "spaces behind delimiters": plain().replace(",", ",   "),
    "spaces around": plain().replace(",", " , "),
    "spaces and quotes": plain().replace("t,pa (kPa),pb,angle", '"t", "pa (kPa)", "pb", "angle"'),
    "empty lines": plain().replace("\n", "\n\n"),
    "rows of delimiters at the end": plain() + ",,,\n,,,\n",
    "no end of the last line": plain()[:-1],
    "another column of text": "\n".join(
        f"12:00:0{k % 7},{line}" if k else f"Uhrzeit [\N{DEGREE SIGN}],{line}"
        for k, line in enumerate(lines())
    ).encode("latin-1"),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_each_layout_gives_the_same_numbers(tmp_path, name):
    found = read(tmp_path, LAYOUTS[name])
    same(found)
    assert found.notes == ()


def test_spaces_divide_cells(tmp_path):
    text = plain().replace("pa (kPa)", '"pa (kPa)"').replace(",", "   ")
    same(read(tmp_path, "  " + text))


def damaged(row: int, line: str | bytes) -> bytes:
    found = [line.encode() for line in lines()]
    found[row + 1] = line.encode() if isinstance(line, str) else line
    return b"\n".join(found) + b"\n"


ROW = lines()[11]
DAMAGE = {
    "cut": damaged(10, ROW[:20]),
    "cut and grown together": damaged(10, ROW[:14] + ROW),
    "zeros": damaged(10, b"\0" * 40),
    "zeros in a number": damaged(10, ROW[:12].encode() + b"\0\0\0" + ROW[15:].encode()),
    "a text": damaged(10, ROW.replace(",", ",ERR", 1)),
    "bytes of no text": damaged(10, b"\xff\xfe\x80" * 9),
    "an open quote": damaged(10, '"' + ROW),
    "a digit divided by _": damaged(10, ROW.replace("0", "0_0", 1)),
    "a cell too many": damaged(10, ROW + ",1"),
    "the names again": damaged(10, lines()[0]),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_row_is_left_out_counted_and_named(tmp_path, name):
    found = read(tmp_path, DAMAGE[name])
    same(found, np.arange(N) != 10)
    assert found.notes[0].startswith("1 of 40 rows left out; the first is line 12: ")
    assert found.notes[0] in summary(found)


def test_an_empty_cell_costs_its_stream_alone(tmp_path):
    found = read(tmp_path, damaged(10, ROW.rpartition(",")[0] + ",N/A"))
    assert (len(found.pressure.t), len(found.bends[0].t)) == (N, N - 1)


@pytest.mark.parametrize("cut", [3, 9, 12, 30])
def test_a_file_may_be_cut_in_its_last_row(tmp_path, cut):
    """Also in its last number, which is then a wrong one."""
    found = read(tmp_path, plain()[: -1 - (len(lines()[-1]) - cut)])
    same(found, slice(0, N - 1))
    assert found.notes[0].startswith("1 of 40 rows left out; the first is line 41: ")


FORMATS = {
    "exponents": ("{:.3e}", ["-4.210e-0", "-4.210e-", "-4.210e", "-4.21", "-4.", "-", ""]),
    "exponents of one digit": ("{:.3e}", ["2.000e-1", "2.000e+0", "2.000E0"]),
    "the shortest numbers": ("{:g}", ["0.1", "0.123", "0.1234567", "12", "1e-05", "1.5e-05"]),
    "whole numbers": ("{:.0f}", ["10", "1013"]),
    "decimal commas": ("{:.4f}", ["1,0", "1,000"]),
}


@pytest.mark.parametrize("name", FORMATS)
def test_no_last_number_that_may_be_cut_counts(tmp_path, name):
    """What is left of a number is one too: only a format that all rows have shows that it is whole."""
    form, ends = FORMATS[name]
    rows = ["t;angle", *(f"{0.5 * k:.1f};{form.format(-3.0 + 0.25 * k)}" for k in range(1, 9))]

    def last(end: str) -> tuple[int, str]:
        text = "\n".join([*rows, f"4.5;{end}"])
        (tmp_path / "run.csv").write_text(text.replace(".", ",") if "," in end else text)
        table, note = read_table(tmp_path / "run.csv", ("t", "angle"))
        return len(table["angle"]), note

    for end in ends:
        count, note = last(end)
        assert (count, note[:53]) == (8, "1 of 9 rows left out; the first is line 10: the file "), end
    whole = form.format(-0.75)
    assert last(whole)[0] == (9 if name in ("exponents", "exponents of one digit", "decimal commas") else 8)
    assert last(whole + "\n") == (9, "")


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        (plain().replace("pa (kPa)", '"a, b (kPa)"'), "'pa (kPa)'", ("columns t, 'a, b (kPa)', pb",)),
        (plain().replace("pb", "pa (kPa)", 1), "pb", ("columns t, 'pa (kPa)', 'pa (kPa)', angle\"",)),
        (plain().replace("t,pa (kPa),pb,angle", "t,pa (kPa),pb,angle,pb").replace("\n", ",1\n"), "pb", ()),
        ("\n".join(line.replace(".", ",") for line in lines()) + "\n", "line 2", ("8 cells", "4 names")),
        (plain().replace("\n", "\n2026-01-01 12:00:0"), "line 2", ("no number",)),
        ("PK\x03\x04 and more", "", ("spreadsheet",)),
        ("", "t", ()),
        ("\0" * 100, "t", ()),
        ("\n".join(line.replace(".", ".1.") for line in lines()), "", ("no number",)),
        (plain().split("\n")[0], "", ("0 rows",)),
    ],
)
def test_what_cannot_be_read_is_one_line(tmp_path, text, key, words):
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, text)
    assert caught.value.where == str(tmp_path / "run.csv")
    assert key in ("", caught.value.key)
    assert all(word in str(caught.value) for word in words)
    assert len(str(caught.value).splitlines()) == 1


def test_names_with_spaces_and_commas_have_quotes(tmp_path):
    path = tmp_path / "run.csv"
    with fails(ConfigError, "the columns 'time, s', b", where=str(path)):
        read_table(path, ("time, s", "b"))
    path.write_text('"time, s","a b","a b"\n0,1,2\n1,1,2\n')
    with fails(ConfigError, "2 columns", where=str(path), key="'a b'"):
        read_table(path, ("time, s", "a b"))
    path.write_text('"time, s","a b"\n0,inf\n1,inf\n')
    with fails(ConfigError, "inf in row 1", where=str(path), key="'a b'"):
        read_columns(path, ("time, s", "a b"))
    path.write_text('"time, s","a b"\n1,0\n0,1\n')
    with fails(ConfigError, "do not rise", where=str(path), key="'time, s'"):
        read_columns(path, ("time, s",))
    path.write_text("t,pd_left arm\n0,0\n1,1\n")
    with fails(ConfigError, "only 'pd_left arm'", where=str(path), key="'pm_left arm'"):
        read_pressures(path)


def test_two_columns_of_a_name_that_the_map_uses_are_refused(tmp_path):
    twice = [names + ",angle" if k == 0 else names + ",0.0" for k, names in enumerate(lines())]
    with fails(ConfigError, "2 columns", where=str(tmp_path / "run.csv"), key="angle"):
        read(tmp_path, "\n".join(twice) + "\n")
    unused = [names + ",x,x" if k == 0 else names + ",0.0,1.0" for k, names in enumerate(lines())]
    same(read(tmp_path, "\n".join(unused) + "\n"))


def test_marks_of_thousands_are_refused(tmp_path):
    """What reads as another number by a factor of a thousand is never guessed."""
    names = ";".join(NAMES)
    grouped = [names, *(f"{k};1.013,25;10,5;1,0" for k in range(20))]
    with fails(ConfigError, "1.013,25", where=str(tmp_path / "run.csv"), key="line 2"):
        read(tmp_path, "\n".join(grouped) + "\n")
    mixed = [names, *(f"{k};13,25;10.5;1,0" for k in range(20))]
    with fails(ConfigError, "decimal", where=str(tmp_path / "run.csv"), key="line 2"):
        read(tmp_path, "\n".join(mixed) + "\n")
    quoted = [lines()[0]] + [f'{0.1 * k:.1f},"101,325","101,425",1.0' for k in range(20)]
    with fails(ConfigError, "101,325", where=str(tmp_path / "run.csv"), key="line 2"):
        read(tmp_path, "\n".join(quoted) + "\n")


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "  "])
def test_modes_may_have_any_layout(tmp_path, delimiter):
    table = [[0.5, -1.25, 1e-3], [1.0, 2.5, 3.75]]
    text = "\n".join(delimiter.join(f"{x:.5f}" for x in row) for row in table)
    marks = {",": "."}.get(delimiter, ",")
    (tmp_path / "m.csv").write_text("# modes\n" + text.replace(".", marks) + "\n")
    assert read_matrix(tmp_path / "m.csv") == table
    (tmp_path / "m.csv").write_text(text + f"\n1{delimiter}x{delimiter}2\n")
    with pytest.raises(ValueError, match="line 3: 'x'"):
        read_matrix(tmp_path / "m.csv")


def test_a_table_of_pressures_says_what_is_left_out(tmp_path, caplog):
    path = tmp_path / "steps.csv"
    rows = [f"{0.1 * k:.1f};{k % 2}000,0;{k % 3}00,0".replace(".", ",") for k in range(30)]
    rows[5], rows[9], rows[12] = rows[5][:3], rows[8], "1,2;nan;0,0"
    path.write_text("rig 3\nt;pd_a;pm_a\ns;Pa;Pa\n" + "\n".join(rows) + "\n")
    with caplog.at_level(logging.WARNING, "soro_lab"):
        found = read_pressures(path)
    assert len(found.t) == 27
    assert "1 of 30 rows left out; the first is line 9: 1 cells" in caplog.text
    assert "2 rows left out: a value is not finite, or the time does not rise" in caplog.text


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared outside cases are not here")
@pytest.mark.parametrize(
    "name", ["comment", "quoted", "semicolon", "tab", "with_preamble", "last_cut", "nul"]
)
def test_files_of_real_loggers(name):
    from soro_core.robot import load_robot

    folder = CASES / "csv_layouts"
    arm, columns = load_robot(folder / "limb.yaml"), folder / "map.yaml"
    right = read_csv(folder / "plain.csv", columns, arm)
    path = next(CASES.glob(f"csv_*/{name}.csv"))
    found = read_csv(path, columns, arm)
    damage = found.faults[0].samples - 600
    assert damage == (-1 if name == "last_cut" else 0)
    assert bool(found.notes) == (path.parent != folder)
    rows = slice(0, len(found.bends[0].t))
    np.testing.assert_allclose(found.bends[0].angle, right.bends[0].angle[rows], atol=1e-9)
    np.testing.assert_allclose(
        found.pressure.values, right.pressure.values[: len(found.pressure.t)], rtol=1e-12
    )
