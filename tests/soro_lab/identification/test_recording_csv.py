"""CSV files as recordings: units, frames, what is left out and counted, and one line for what is wrong."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_recordings import CHAMBERS, robot, write_csv
from scipy.spatial.transform import Rotation

from soro_core.config import load, parse
from soro_core.errors import ConfigError
from soro_lab.identification.recording import Columns, Place, read_csv, summary
from tests.refused import fails, refused

PRESSURES = {"columns": {CHAMBERS[0]: "pa", CHAMBERS[1]: "pb"}}
POINT = {"link": 1, "position": ["x", "y", "z"]}
PLAIN = {"pressures": PRESSURES, "markers": {"tip": POINT}}
N = 50
BY_FILE = "pressures.stated_by_file"
SHIPPED = sorted((Path(__file__).parents[3] / "config/recordings").glob("*.yaml"))


def columns(**changes: Any) -> Columns:
    return parse({**PLAIN, **changes}, Columns, where="map.yaml")


def table(**changes: Any) -> dict[str, Any]:
    k = np.arange(N)
    point = {"x": 1e-3 * k, "y": 1e-4 * k, "z": 0.2 - 1e-5 * k}
    return {"t": 0.01 * k, "pa": 100.0 * k, "pb": 5e3 + 10.0 * k, **point, **changes}


def put(values: Any, row: int, value: float) -> np.ndarray:
    changed = np.array(values, float)
    changed[row] = value
    return changed


def test_units_become_si(tmp_path):
    k = np.arange(N)
    point = {"x": 1.0 * k, "y": 2.0 * k, "z": 3.0 * k}
    bent = {"c": k, "d": -1.0 * k, "b": 2.0 * k}
    file = write_csv(tmp_path / "run.csv", table(t=10.0 * k, pa=0.01 * k, pb=-0.001 * k, **point, **bent))
    found = read_csv(
        file,
        columns(
            time={"unit": "ms"},
            pressures={**PRESSURES, "unit": "bar", "offset_pa": 500.0},
            commands={**PRESSURES, "unit": "V", "scale_pa_v": 2e4, "offset_pa": -100.0},
            markers={"tip": {**POINT, "unit": "mm", "offset_m": [0.01, 0.0, -0.02]}},
            curvatures={"bent": {"link": 1, "columns": ["c", "d"], "unit": "1/mm"}},
            bends={"angle": {"column": "b", "unit": "deg"}},
        ),
        robot(),
    )
    np.testing.assert_allclose(found.pressure.t, 0.01 * k)
    np.testing.assert_allclose(found.pressure.values, np.column_stack([1e3 * k, -100.0 * k]) + 500.0)
    np.testing.assert_allclose(found.command.values, np.column_stack([200.0 * k, -20.0 * k]) - 100.0)
    np.testing.assert_allclose(found.markers[0].position, 1e-3 * np.column_stack([k, 2 * k, 3 * k]))
    assert (found.markers[0].place, found.markers[0].offset) == (Place(1), (0.01, 0.0, -0.02))
    np.testing.assert_allclose(found.curvatures[0].curvature, 1e3 * np.column_stack([k, -k]))
    np.testing.assert_allclose(found.bends[0].angle, np.radians(2 * k))
    assert (found.name, found.chambers, found.frame, found.is_stated) == ("run", CHAMBERS, "tracker", False)


def test_stated_levels_are_reached_with_a_lag_of_each_direction(tmp_path):
    steps = {CHAMBERS[1]: [[0.0, 1.0], [0.1, 3.0], [0.3, 0.0]]}
    pressures = {"columns": {CHAMBERS[0]: "pa"}, "stated": steps, "stated_lag_s": [0.05, 0.2]}
    found = read_csv(write_csv(tmp_path / "run.csv", table()), columns(pressures=pressures), robot())
    t, p = found.pressure.t, found.pressure.values[:, 1]
    top = 3.0 - 2.0 * np.exp(-0.2 / 0.05)
    rise, fall = (t >= 0.1) & (t < 0.3 - 1e-9), t >= 0.3 - 1e-9
    np.testing.assert_allclose(p[t < 0.1 - 1e-9], 1.0)
    np.testing.assert_allclose(p[rise], 3.0 - 2.0 * np.exp(-(t[rise] - 0.1) / 0.05), rtol=1e-9)
    np.testing.assert_allclose(p[fall], top * np.exp(-(t[fall] - 0.3) / 0.2), rtol=1e-9)


def test_places_keep_the_name_of_their_frame(tmp_path):
    found = read_csv(write_csv(tmp_path / "run.csv", table()), columns(frame="second"), robot())
    assert [marker.frame for marker in found.markers] == ["second"]


def test_levels_are_stated_where_no_pressure_was_recorded(tmp_path):
    """Of all files, or by file; a chamber has a column or levels."""
    steps = {CHAMBERS[1]: [[0.0, 1.0], [0.1, 3.0], [0.3, 0.0]]}
    mixed = columns(pressures={"columns": {CHAMBERS[0]: "pa"}, "stated": steps})
    found = read_csv(write_csv(tmp_path / "run.csv", table()), mixed, robot())
    t = found.pressure.t
    levels = np.where(t < 0.1, 1.0, np.where(t < 0.3, 3.0, 0.0))
    np.testing.assert_array_equal(found.pressure.values[:, 1], levels)
    assert not found.is_stated
    both = {CHAMBERS[0]: [[0.0, 0.0]], **steps}
    files = {"low": both, "high": {**both, CHAMBERS[0]: [[0.0, 7.0]]}}
    by_file = columns(pressures={"unit": "mbar", "stated_by_file": files})
    low, high = (read_csv(write_csv(tmp_path / f"{name}.csv", table()), by_file, robot()) for name in files)
    np.testing.assert_array_equal(low.pressure.values[15], [0.0, 300.0])
    np.testing.assert_array_equal(high.pressure.values[15], [700.0, 300.0])
    # Nothing is dropped from levels that stand still.
    assert high.is_stated
    assert len(high.pressure.t) == N
    assert "stated" in summary(high)
    with fails(ConfigError, CHAMBERS[0], where="columns", key="pressures.stated_by_file.run"):
        read_csv(tmp_path / "run.csv", by_file, robot())
    with fails(ConfigError, where="columns", key=f"pressures.stated.{CHAMBERS[0]}"):
        read_csv(tmp_path / "run.csv", columns(pressures={**PRESSURES, "stated": both}), robot())


@pytest.mark.parametrize(("moves", "turns"), [(False, True), (True, True), (False, False)])
def test_a_body_on_the_base_is_the_frame(tmp_path, moves, turns):
    """Whatever the frame of the tracker; the lab may move the base, or not use its rotation."""
    k = np.arange(N)
    slow = 0.02 * k * moves
    base = Rotation.from_rotvec(np.column_stack([0.3 + slow, -slow, 0.5 * np.ones(N)]))
    base_at = np.column_stack([1.0 + slow, 2.0 * np.ones(N), 3.0 * np.ones(N)])
    tip = Rotation.from_rotvec(np.column_stack([0.01 * k, np.zeros(N), 0.2 * np.ones(N)]))
    tip_at = np.column_stack([1e-3 * k, np.zeros(N), 0.2 * np.ones(N)])
    seen, seen_at = base * tip, base.apply(tip_at) + base_at
    signs = np.where(k % 2, 1.0, -1.0)[:, None]  # q and -q are one rotation
    poses = {}
    for name, turn, at in (("b", base, base_at), ("p", seen, seen_at)):
        poses |= {f"{name}{axis}": at[:, i] for i, axis in enumerate("xyz")}
        poses |= {f"{name}q{axis}": (signs * turn.as_quat())[:, i] for i, axis in enumerate("xyzw")}
    keys = {
        name: {"position": [f"{name}{a}" for a in "xyz"], "quaternion": [f"{name}q{a}" for a in "xyzw"]}
        for name in "bp"
    }
    bodies = {
        "base": {**keys["b"], "moves": moves, "turns": turns},
        "plates": {"tip": {**keys["p"], "link": 1}},
        "markers": {"dot": {"link": 0, "position": ["px", "py", "pz"]}},
    }
    found = read_csv(write_csv(tmp_path / "run.csv", table(**poses)), columns(**bodies), robot())
    assert found.frame == "base"
    if not turns:  # the axes stay those of the tracker
        tip, tip_at = seen, base.apply(tip_at)
    np.testing.assert_allclose(found.plates[0].position, tip_at, atol=1e-9)
    np.testing.assert_allclose(found.markers[0].position, tip_at, atol=1e-9)
    off = (Rotation.from_quat(found.plates[0].quaternion).inv() * tip).magnitude()
    assert off.max() < 1e-7
    assert [each.stream for each in found.faults] == ["pressure", "base", "tip", "dot"]


def test_what_cannot_be_used_is_left_out_and_counted(tmp_path):
    found_table = table(
        pa=put(put(table()["pa"], 3, np.nan), 4, 1e6),  # missing; beyond 1.5 times the range of the robot
        x=put(put(table()["x"], 7, np.inf), 8, np.nan),
        ok=put(np.ones(N), 9, 0.0),
        qw=put(put(np.ones(N), 10, 0.5), 11, 1.05),
        q0=np.zeros(N),
        t=put(table()["t"], 20, 0.19),
        kx=put(0.1 * np.arange(N), 30, 900.0),
        ky=np.zeros(N),
    )
    plate = {**POINT, "quaternion": ["q0", "q0", "q0", "qw"], "ok": "ok"}
    chosen = columns(markers={}, plates={"tip": plate}, curvatures={"bent": {"range": [-9.0, 9.0]}})
    found = read_csv(write_csv(tmp_path / "run.csv", found_table), chosen, robot())
    pressure, tip, bent = found.faults
    assert (pressure.not_finite, pressure.outside, pressure.backwards, pressure.left_out) == (1, 1, 1, 3)
    assert (tip.not_finite, tip.not_ok, tip.backwards, tip.left_out) == (2, 2, 1, 5)
    assert (bent.outside, bent.left_out) == (1, 2)
    left_out = (3, 4, 20), (7, 8, 9, 10, 20), (20, 30)
    for stream, rows in zip((found.pressure, *found.plates, *found.curvatures), left_out, strict=True):
        np.testing.assert_array_equal(stream.t, np.delete(found_table["t"], rows))
    np.testing.assert_allclose(np.linalg.norm(found.plates[0].quaternion, axis=1), 1.0)
    for text in ("1 not finite", "1 outside the range", "2 marked bad"):
        assert text in summary(found)
    # A range that the map states takes the place of the robot's.
    wide = columns(pressures={**PRESSURES, "range": [0.0, 2e6]}, markers={"tip": POINT})
    assert read_csv(tmp_path / "run.csv", wide, robot()).faults[0].outside == 0


def test_a_stream_without_usable_samples_is_refused(tmp_path):
    file = write_csv(tmp_path / "run.csv", table(pb=np.full(N, np.nan)))
    with fails(ConfigError, f"{N} not finite", where=str(file), key="pressure"):
        read_csv(file, columns(), robot())
    file = write_csv(tmp_path / "high.csv", table(pb=np.full(N, 9e5)))
    with fails(ConfigError, f"{N} outside", where=str(file), key="pressure"):
        read_csv(file, columns(), robot())


def test_time_that_runs_backwards_is_refused(tmp_path):
    t = table()["t"] - 0.2 * (np.arange(N) >= 30)
    file = write_csv(tmp_path / "run.csv", table(t=t))
    with fails(ConfigError, "sample 31", "0.100", "0.290", where=str(file), key="pressure"):
        read_csv(file, columns(), robot())


@pytest.mark.parametrize("stamp", [-5.0, 0.1, 0.45, 1e9])
def test_one_stamp_far_off_costs_its_row(tmp_path, stamp):
    file = write_csv(tmp_path / "run.csv", table(t=put(table()["t"], 30, stamp)))
    found = read_csv(file, columns(), robot())
    np.testing.assert_allclose(found.pressure.t, np.delete(table()["t"], 30))
    assert found.faults[0].backwards == 1


@pytest.mark.parametrize(
    ("changes", "key", "names"),
    [
        ({"pressures": {"columns": {"link0/chamber1": "pb"}}}, "pressures.columns", CHAMBERS),
        ({"pressures": {**PRESSURES, "stated": {"left": [[0.0, 0.0]]}}}, "pressures.stated", CHAMBERS),
        ({"pressures": {"columns": {CHAMBERS[0]: "pa"}}}, "pressures.columns", ()),
        ({"commands": {"columns": {"left": "pa"}}}, "commands.columns", CHAMBERS),
        ({"commands": {"columns": {CHAMBERS[0]: "pa"}}}, "commands.columns", ()),
        ({"markers": {"tip": {**POINT, "link": 2}}}, "markers.tip.link", ("0 to 1",)),
        ({"markers": {"tip": {**POINT, "s_m": 0.2}}}, "markers.tip.s_m", ("0.1",)),
        ({"curvatures": {"bent": {"link": 5}}}, "curvatures.bent.link", ("0 to 1",)),
        ({"bends": {"bent": {"link": 5, "column": "pa"}}}, "bends.bent.link", ("0 to 1",)),
    ],
)
def test_a_map_that_does_not_fit_the_robot_is_refused(tmp_path, changes, key, names):
    with refused(key=key, names=names) as caught:
        read_csv(write_csv(tmp_path / "run.csv", table()), columns(**changes), robot())
    assert caught.value.where == "columns"


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"pressures": {**PRESSURES, "unit": "psi"}}, "pressures.unit"),
        ({"pressures": {**PRESSURES, "unit": "V"}}, "pressures"),
        ({"pressures": {**PRESSURES, "scale_pa_v": 2.0}}, "pressures"),
        ({"pressures": {**PRESSURES, "range": [1.0, 1.0]}}, "pressures"),
        ({"pressures": {"stated": {"a": [[0.0, 1.0], [0.0, 2.0]]}}}, "pressures.stated"),
        ({"pressures": {"stated_by_file": {"f": {"a": [[1.0, 1.0], [0.0, 2.0]]}}}}, BY_FILE),
        ({"duty": {"columns": {}}}, "duty.columns"),
        ({"markers": {"command": POINT}}, ""),
        ({"bends": {"tip": {"column": "pa"}}}, ""),
        ({"markers": {"tip": {**POINT, "offset": [0.0, 0.0, 0.0]}}}, "markers.tip.offset"),
        ({"markers": {"tip": {"link": 0, "position": ["x", "y"]}}}, "markers.tip.position[2]"),
        ({"time": {"unit": "min"}}, "time.unit"),
    ],
)
def test_a_bad_map_is_refused(changes, key):
    with fails(ConfigError, where="map.yaml", key=key):
        columns(**changes)


def test_a_missing_column_is_named_with_the_key_that_asks_for_it(tmp_path):
    file = write_csv(tmp_path / "run.csv", {name: values for name, values in table().items() if name != "pb"})
    with refused(key="pb", names=(f"pressures.columns.{CHAMBERS[1]}",)) as caught:
        read_csv(file, columns(), robot())
    assert caught.value.where == str(file)
    with fails(ConfigError, where=str(tmp_path / "absent.csv")):
        read_csv(tmp_path / "absent.csv", columns(), robot())
    (tmp_path / "text.csv").write_text("t,pa,pb,x,y,z\n0,1,2,3,4,five\n1,1,2,3,4,5\n")
    with fails(ConfigError, "five", where=str(tmp_path / "text.csv")):
        read_csv(tmp_path / "text.csv", columns(), robot())


def test_a_map_is_a_file_or_a_shipped_name(tmp_path):
    file = write_csv(tmp_path / "run.csv", table())
    with refused(key="", names=("tue_forced", "asu_two_segment")):
        read_csv(file, "asu", robot())
    bad = tmp_path / "map.yaml"
    bad.write_text("pressures: {columns: {link0/chamber0: pa, left: pb}}\nbends: {tip: {column: x}}\n")
    with fails(ConfigError, where=str(bad), key="pressures.columns"):
        read_csv(file, bad, robot())


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_maps_say_what_they_are_of(path):
    assert load(path, Columns).description
