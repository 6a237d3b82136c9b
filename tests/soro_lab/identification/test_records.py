"""Recorded runs as CSV: what is read, and one line for what is wrong."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.segment_runs import read_release
from soro_core.errors import ConfigError
from soro_lab.identification import read_forced
from tests.refused import fails

GOOD = "t,p1,p2,p3,kx,ky\n0,1000,2000,3000,0.5,-0.5\n1,2000,2000,1000,1.5,-1.5\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "run.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_forced_run(tmp_path: Path) -> None:
    run = read_forced(written(tmp_path, GOOD))
    np.testing.assert_array_equal(run.pressure, [[1000, 2000, 3000], [2000, 2000, 1000]])
    np.testing.assert_allclose(run.pressure_at(0.5), [1500, 2000, 2000])
    np.testing.assert_allclose(run.pressure_at(9.0), [2000, 2000, 1000])
    np.testing.assert_allclose(run.curvature_at(np.array([0.25])), [[0.75, -0.75]])
    assert len(run.window(0.0, 1.0).t) == 1


def test_release_is_in_radians_from_zero(tmp_path: Path) -> None:
    run = read_release(written(tmp_path, "t,bend_deg\n2.0,180\n2.5,90\n"))
    np.testing.assert_allclose(run.t, [0.0, 0.5])
    np.testing.assert_allclose(run.bend, [np.pi, np.pi / 2])


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (GOOD.replace("ky", "kz"), ("ky",)),
        (GOOD.replace("1.5,", "nan,"), ("kx",)),
        (GOOD.replace("\n1,", "\n0,"), ("t", "rise")),
        (GOOD.replace("2000", "two"), ("line 2", "two")),
        (GOOD.replace(",-1.5", ""), ("line 3", "5 cells", "6 names")),
        ("t,p1,kx,ky\n0,0,0,0\n", ("", "rows")),
    ],
)
def test_a_bad_file_is_named_in_one_line(tmp_path: Path, text: str, found: tuple[str, ...]) -> None:
    with fails(ConfigError, *found[1:], where=str(tmp_path / "run.csv"), key=found[0]):
        read_forced(written(tmp_path, text))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with fails(ConfigError, "no such file", where=str(tmp_path / "absent.csv")):
        read_forced(tmp_path / "absent.csv")
