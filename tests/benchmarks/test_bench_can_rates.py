"""The section of rates over the paced bus runs through; no rate that it must reach is asserted."""

import pytest
from result_tables import tables, written

from benchmarks.can_rates import LAYOUTS, TITLE, platform
from soro_core.config import parse
from soro_hardware.canopen.budget import highest_rate_hz
from soro_hardware.canopen.config import CanopenPlatform


@pytest.mark.process
def test_every_cycle_is_made_and_none_faster_than_the_bus(tmp_path):
    text = written(tmp_path, "can_rates")
    assert f"## {TITLE}" in text
    asked, limits = tables(text)
    assert [row["cycles"] for row in asked] == ["25", "50"]
    assert [(row["bits a cycle"], row["bus allows, Hz"]) for row in limits] == [
        ("2335", "428.3"),
        ("865", "1156"),
    ]
    assert [row["not above"] for row in limits] == ["met", "met"]


def test_layouts_are_twelve_chambers_within_the_bus():
    for layout in LAYOUTS:
        loaded = parse(platform(layout), CanopenPlatform, where=layout.name)
        assert len(loaded.valves) == 12
        assert layout.rate_hz < 0.6 * highest_rate_hz(loaded)
