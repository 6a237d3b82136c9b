"""A new arm, from its description to a controlled tip, by the commands that a user types."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from tests.soro_ros.whole_way import ARMS, walk

# Its commands compute for minutes beside workers of a higher priority.
pytestmark = [pytest.mark.process, pytest.mark.timeout(600)]

# As short as determines what the control needs; `make identify` goes the whole way with three arms.
EXCITED = ("--stages", "singles,together,steps", "--levels", "2", "--duration", "45")
IDENTIFIED = ("--laws", "none", "--starts", "1")
# Its last 5 s are after the way up; wrong numbers are seen there before adaptation makes up for them.
TRACKED = ("--set", "duration_s=8")


def test_an_arm_whose_numbers_no_file_states_is_identified_and_controlled(
    domain: int, tmp_path: Path
) -> None:
    arm = replace(ARMS[0], excited=EXCITED, identified=IDENTIFIED, tracked=TRACKED)
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    outcome = walk(arm, tmp_path, print, environment)
    assert [n for n in outcome.numbers if not n.is_right] == [], outcome.output
    # A short excitation shows chambers against each other best: other numbers have their doubt.
    assert {"link0/k_b", "link0/chamber1/gain", "link0/chamber2/gain"} <= {n.name for n in outcome.numbers}
    assert outcome.tip_m <= 0.01 * outcome.length_m
