"""The section of measured step responses runs through; tests/soro_lab/identification asserts its figures."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.air_fit import TITLE


def measured(folder: Path) -> str:
    arguments = ["--quick", "--no-peer", "--out", str(folder), "--only", "air_fit"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return (folder / "RESULTS.md").read_text()


@pytest.mark.slow
def test_section_is_written_with_numbers_and_a_picture(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not (data / "asu_two_segment").is_dir():
        pytest.skip(f"no data set asu_two_segment in {data} (set SORO_DATA)")
    monkeypatch.setenv("SORO_DATA", str(data))
    text = measured(tmp_path)
    assert f"## {TITLE}" in text
    rows = [line for line in text.splitlines() if re.match(r"\| (lag|flow|sweep|s\d)", line)]
    assert len(rows) >= 8
    assert not any("nan" in row or "inf" in row for row in rows)
    assert "vent_tau_s:" in text
    assert (tmp_path / "air_fit.png").stat().st_size > 20_000


def test_without_data_the_section_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SORO_DATA", str(tmp_path))
    assert f"Not measured: no data set in {tmp_path}" in measured(tmp_path)
