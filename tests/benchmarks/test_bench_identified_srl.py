"""The shipped silicone segment rings and ends as its file states, on runs that its fit has not seen."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.identified_srl import ROBOT, judged, medians
from soro_core.robot import load_robot


def test_held_out_runs_are_met_as_the_file_states(data: Path, figure: Callable[[str], None]) -> None:
    folder = data / ROBOT
    if not folder.is_dir():
        pytest.skip(f"no data set {ROBOT} in {data} (set SORO_DATA)")
    steps = judged(load_robot(ROBOT), folder)
    held = [step for step in steps if step.is_held_out]
    assert sorted({step.run for step in held}) == [
        "step_A_200mbar",
        "step_C_100mbar",
        "step_C_200mbar",
        "step_C_300mbar",
    ]
    found = medians(held)
    figure(f"{ROBOT}, held out: frequency, damping ratio, end {np.round(100 * found, 1)} %")
    np.testing.assert_allclose(found, [0.011, 0.065, 0.040], atol=0.002)
