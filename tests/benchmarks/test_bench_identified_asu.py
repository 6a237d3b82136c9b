"""The shipped file of the ASU arm, on the runs that were kept back from its fit."""

import numpy as np
import pytest

from benchmarks import identified_asu
from benchmarks.identified_asu import is_driven, is_frozen, is_held_out, squares
from benchmarks.options import Options
from soro_core import SoftArm, load_robot
from soro_lab.identification.recording import read_csv


@pytest.fixture(autouse=True)
def has_data(data):
    if not (data / "asu_two_segment").is_dir():
        pytest.skip(f"no data set asu_two_segment in {data} (set SORO_DATA)")


@pytest.mark.slow
def test_the_shipped_file_predicts_the_runs_that_were_kept_back(data, figure):
    robot = load_robot("asu_two_segment")
    runs = [read_csv(f, "asu_two_segment", robot) for f in sorted((data / "asu_two_segment").glob("*.csv"))]
    assert [r.name for r in runs if not is_driven(r)] == [f"2023_jan_10_1_r{k}" for k in (1, 2, 3)]
    assert [r.name for r in runs if is_frozen(r)] == [f"2023_apr_4_r{k}" for k in (1, 2, 3, 5, 7)]
    kept = [r for r in runs if is_held_out(r.name) and is_driven(r) and not is_frozen(r)]
    assert len(kept) == 7
    tip, first, second = np.sqrt(np.mean([squares(SoftArm(robot), run) for run in kept], axis=0))
    share = 100 * tip / identified_asu.RANGE_M
    figure(f"tip {share:.1f} % of the range, lengths {1e3 * first:.1f} and {1e3 * second:.1f} mm")
    assert share <= 6.5
    assert first <= 8e-3
    assert second <= 6e-3  # the goal is 4 mm: not reached


def test_the_section_runs_and_says_what_it_lacks(data, tmp_path, monkeypatch):
    text = identified_asu.run(Options(False, True, tmp_path))
    assert "| held out, no sensor frozen | 1 |" in text
    monkeypatch.setenv("SORO_DATA", str(tmp_path))
    assert identified_asu.run(Options(False, True, tmp_path)).startswith("Not measured")
