"""The command runs through and judges every row."""

import pytest
from typer.testing import CliRunner

from tests.apparatus.__main__ import SECTIONS, app
from tests.apparatus.faults.matrix import MATRIX


@pytest.mark.process
@pytest.mark.parametrize("name", ["faults", "fuzz", "bags"])
def test_section_is_written_and_as_stated(tmp_path, monkeypatch, name):
    monkeypatch.setattr("tests.apparatus.faults.MATRIX", {"veab_tcp": MATRIX["veab_tcp"]})
    done = CliRunner().invoke(app, ["--quick", "--out", str(tmp_path), "--only", name])
    assert done.exit_code == 0, done.output
    text = (tmp_path / "RESULTS.md").read_text()
    assert text.startswith("# Results of the apparatus")
    assert f"## {SECTIONS[name].TITLE}" in text
    assert "met" in text
    assert "missed" not in text


def test_an_unknown_section_is_refused_by_name():
    done = CliRunner().invoke(app, ["--only", "faults,forward"])
    assert done.exit_code == 2
    assert "forward: allowed are extremes" in done.output
