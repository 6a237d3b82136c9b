"""The report of a run: what it does not know it does not say."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core.scene import load_scene
from soro_ros import report
from soro_ros.recording import EMPTY, Recording, Series


def rows(monkeypatch, ends_s: float, diagnostics=None, **changes) -> dict[str, str]:
    """The table of a recording that ends at a time, with a tip error of 2 mm."""
    scene = load_scene("track_circle", {key.replace("__", "."): value for key, value in changes.items()})
    t = np.arange(0.0, ends_s, 0.005)
    wanted, true = Series(t, np.zeros((t.size, 3))), Series(t, np.full((t.size, 3), [2e-3, 0.0, 0.0]))
    half = Series(t, np.full((t.size, 3), [1e-3, 0.0, 0.0]))
    differences = Series(t, np.tile([3e-3, 3e-3, 0.0, 0.0, 0.02, -0.01], (t.size, 1)))
    recording = Recording(true, true, wanted, EMPTY, EMPTY, EMPTY, diagnostics or {}, (), half)
    if changes.get("arm") == "real":
        recording = replace(recording, shadow=differences)
    monkeypatch.setattr(report, "read", lambda bag, name: recording)
    names, values = report.table(report.summarise("", scene), scene).columns
    return dict(zip(names.cells, values.cells, strict=True))


FIRST, LAST = "tip error RMS, 3 to 8 s", "tip error RMS, last 5 s"


@pytest.mark.parametrize(
    ("ends_s", "duration_s", "first", "last"),
    [
        (20.0, 20.0, "2.00 mm", "2.00 mm"),
        (8.0, 8.0, "2.00 mm", "2.00 mm"),
        (7.0, 7.0, "-", "2.00 mm"),
        (1.5, 1.5, "-", "-"),
        (17.0, 20.0, "2.00 mm", "-"),  # interrupted
        (5.0, 20.0, "-", "-"),
    ],
)
def test_a_window_that_the_run_did_not_fill_is_a_dash(monkeypatch, ends_s, duration_s, first, last):
    found = rows(monkeypatch, ends_s, duration_s=duration_s)
    assert found[f"{FIRST} (while adapting)"] == first
    assert found[LAST] == found["tip error max, last 5 s"] == last
    assert found["estimator's tip error RMS, last 5 s"] == ("0.00 mm" if last != "-" else "-")


def test_without_adaptation_nothing_is_said_of_it(monkeypatch):
    found = rows(monkeypatch, 20.0, controller__adapt=False)
    assert found[FIRST] == "2.00 mm"


def test_what_was_not_measured_is_a_dash(monkeypatch):
    found = rows(monkeypatch, 20.0)
    assert found["loop lateness p50 / p99"] == found["measured pressures"] == "-"
    known = {"regulator": {"lateness_p50_ms": "0.1", "lateness_p99_ms": "0.5"}}
    assert rows(monkeypatch, 20.0, known)["loop lateness p50 / p99"] == "0.10 / 0.50 ms"


def test_of_a_real_arm_the_measured_tip_is_told_and_its_distance_from_the_shadow(monkeypatch):
    found = rows(monkeypatch, 20.0, valves="real", arm="real", controller__adapt=False)
    assert found[LAST] == "1.00 mm"
    assert found["tip, measured to shadow, RMS / max"] == "3.00 / 3.00 mm"
    assert found["bending, measured less shadow, mean / RMS"] == "-0.57 / 0.57 deg"
    assert not any("shadow" in name for name in rows(monkeypatch, 20.0))
