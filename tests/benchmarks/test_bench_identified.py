"""The sections that judge shipped robot files on recordings run through."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.identified_tue import TITLE


def measured(folder: Path) -> str:
    arguments = ["--quick", "--no-peer", "--out", str(folder), "--only", "identified_tue"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return (folder / "RESULTS.md").read_text()


@pytest.mark.slow
def test_the_shipped_file_and_a_law_are_judged(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not (data / "tue_three_bellow").is_dir():
        pytest.skip(f"no data set tue_three_bellow in {data} (set SORO_DATA)")
    monkeypatch.setenv("SORO_DATA", str(data))
    text = measured(tmp_path)
    assert f"## {TITLE}" in text
    (shipped,) = [line for line in text.splitlines() if line.startswith("| the shipped file")]
    vector, size, release = [float(v) for v in re.findall(r"\d\.\d+", shipped)[-4:-1]]
    assert vector <= 0.13
    assert size <= 0.11
    assert release <= 0.14
    assert re.search(
        r"\| linear, area slope \| 8 \| [\d.]+ / [\d.]+ \| [\d.]+ / [\d.]+ \| [\d.]+ \| -?[\d.]+ \|", text
    )


def test_without_data_the_section_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SORO_DATA", str(tmp_path))
    assert f"Not measured: no data set in {tmp_path}" in measured(tmp_path)
