"""The sections of the hardware run through and judge every row; no rate and no time is asserted."""

import re

import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import SECTIONS, app
from benchmarks.faults.matrix import MATRIX


@pytest.mark.parametrize("name", ["faults", "fuzz"])
def test_section_runs_through(tmp_path, monkeypatch, name):
    monkeypatch.setattr("benchmarks.faults.MATRIX", {"veab_tcp": MATRIX["veab_tcp"]})
    done = CliRunner().invoke(app, ["--quick", "--no-peer", "--out", str(tmp_path), "--only", name])
    assert done.exit_code == 0, done.output
    text = (tmp_path / "RESULTS.md").read_text()
    assert f"## {SECTIONS[name].TITLE}" in text
    assert "met" in text
    assert "missed" not in text


@pytest.mark.parametrize("name", ["serial_rates", "board", "kills"])
def test_section_on_the_clock_is_written(tmp_path, name):
    done = CliRunner().invoke(app, ["--quick", "--no-peer", "--out", str(tmp_path), "--only", name])
    assert done.exit_code == 0, done.output
    text = (tmp_path / "RESULTS.md").read_text()
    assert f"## {SECTIONS[name].TITLE}" in text
    assert re.search(r"\| (met|missed) \|", text)
