"""The section of rates over the paced bus runs through; no rate is asserted."""

import re

from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.can_rates import LAYOUTS, TITLE, platform
from soro_core.config import parse
from soro_core.hardware.canopen.budget import highest_rate_hz
from soro_core.hardware.canopen.config import CanopenPlatform


def test_section_is_written_with_numbers(tmp_path):
    done = CliRunner().invoke(app, ["--quick", "--no-peer", "--out", str(tmp_path), "--only", "can_rates"])
    assert done.exit_code == 0, done.output
    text = (tmp_path / "RESULTS.md").read_text()
    assert f"## {TITLE}" in text
    rows = [line for line in text.splitlines() if re.match(r"\| (12|3) nodes", line)]
    assert len(rows) == 4
    assert not any("nan" in row or "inf" in row for row in rows)
    assert "| 2335 | 428.3 |" in text
    assert "| 865 | 1156 |" in text


def test_layouts_are_twelve_chambers_within_the_bus():
    for layout in LAYOUTS:
        loaded = parse(platform(layout), CanopenPlatform, where=layout.name)
        assert len(loaded.valves) == 12
        assert layout.rate_hz < 0.6 * highest_rate_hz(loaded)
