"""The four recorded sets of real robots, against numbers taken straight from their files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from made_recordings import robot

from soro_core.config import find_config, load, with_changes
from soro_core.robot import Robot, load_robot
from soro_lab.identification.recording import (
    Columns,
    Place,
    Recording,
    check_motion,
    decays,
    excited,
    hold_out,
    read_csv,
    rest_states,
    sections,
    still_limits,
    summary,
)

LINES = ("s2r", "s2l", "s2m", "s1r", "s1l", "s1m")


@pytest.fixture(scope="module")
def asu(data: Path) -> Path:
    return folder(data, "asu_two_segment")


@pytest.fixture(scope="module")
def tue(data: Path) -> Path:
    return folder(data, "tue_three_bellow")


@pytest.fixture(scope="module")
def srl(data: Path) -> Path:
    return folder(data, "srl_one_segment")


def folder(data: Path, name: str) -> Path:
    if not (data / name).is_dir():
        pytest.skip(f"no data set {name} in {data} (set SORO_DATA)")
    return data / name


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot("asu_two_segment")


def table(path: Path) -> np.ndarray:
    return np.genfromtxt(path, delimiter=",", names=True)


def new_rows(columns: np.ndarray) -> np.ndarray:
    return np.concatenate([[True], (np.diff(columns, axis=0) != 0.0).any(axis=1)])


def pose(rows: np.ndarray, body: str) -> np.ndarray:
    return np.column_stack([rows[f"{body}_{name}"] for name in ("x", "y", "z", "qx", "qy", "qz", "qw")])


def test_asu_drops_repeated_samples_of_each_stream(asu: Path, arm: Robot) -> None:
    """A log of February: every stream has its own clock, and each reading is repeated until the next."""
    file = asu / "2023_feb_2_1_r1.csv"
    rows, found = table(file), read_csv(file, "asu_two_segment", arm)
    measured = np.column_stack([rows[f"pm_{line}"] for line in LINES])
    np.testing.assert_array_equal(found.pressure.values, measured[new_rows(measured)])
    np.testing.assert_array_equal(found.pressure.t, rows["t"][new_rows(measured)])
    wanted = np.column_stack([rows[f"pd_{line}"] for line in LINES])
    np.testing.assert_array_equal(found.command.values, wanted)
    for plate, body, place in zip(found.plates, ("rb2", "rb3"), (Place(0), Place(1)), strict=True):
        np.testing.assert_array_equal(plate.t, rows["t"][new_rows(pose(rows, body))])
        assert plate.place == place
    repeated = {each.stream: each.repeated for each in found.faults}
    assert repeated == {"pressure": 1711, "command": 0, "base": 1904, "middle": 1907, "tip": 1903}
    assert not any(each.frozen for each in found.faults)


def test_asu_poses_are_in_the_axes_of_the_tracker_from_the_base_plate(asu: Path, arm: Robot) -> None:
    file = asu / "2023_jan4_r2.csv"
    rows, found = table(file), read_csv(file, "asu_two_segment", arm)
    base, tip = pose(rows, "rb1"), pose(rows, "rb3")
    expected = tip[:, :3] - np.median(base[:, :3], axis=0)
    kept = np.isin(rows["t"], found.plates[1].t)
    # The base has repeated samples, which the median of all rows counts again.
    np.testing.assert_allclose(found.plates[1].position, expected[kept], atol=5e-5)
    turned = np.abs(np.sum(found.plates[1].quaternion * tip[kept, 3:], axis=1))
    np.testing.assert_allclose(turned, 1.0, atol=1e-4)
    assert found.frame == "base"
    # Nine poses of the tip are marked as bad in the file, five in another one.
    marked = {each.stream: each.not_ok for each in found.faults}
    assert (marked["tip"], marked["middle"], int((rows["rb3_qok"] == 0).sum())) == (9, 0, 9)
    other = read_csv(asu / "2023_jan_10_4_r1.csv", "asu_two_segment", arm)
    assert {each.stream: each.not_ok for each in other.faults}["tip"] == 5


def test_asu_the_arm_bends_in_one_plane_of_the_tracker_and_not_of_the_base_plate(
    asu: Path, arm: Robot
) -> None:
    """The rotation of the base plate is wrong: on 7 March it turns a plane motion out of its plane."""
    used = load(find_config("asu_two_segment", "recordings"), Columns)
    assert used.base is not None
    turned = with_changes(used, base=with_changes(used.base, turns=True))
    off = {}
    for name in ("2023_mar_7_r1", "2023_apr_4_r1", "2023_jan4_r1"):
        for kind, columns in (("tracker", used), ("plate", turned)):
            seen = read_csv(asu / f"{name}.csv", columns, arm).plates[1].position
            off[name, kind] = float(np.abs(seen[:, 1]).max())
    assert max(off[name, "tracker"] for name, _ in off) < 7e-3
    assert off["2023_mar_7_r1", "plate"] > 30e-3


def test_asu_six_pressures_are_frozen_in_five_runs_and_no_other(asu: Path, arm: Robot) -> None:
    """While the arm rests, set points stand still and only the noise of the poses goes on."""
    frozen = {}
    for file in sorted(asu.glob("*.csv")):
        found = read_csv(file, "asu_two_segment", arm)
        for each in found.faults:
            for start, end in each.frozen:
                frozen[file.stem, each.stream] = (round(start, 1), round(end, 1))
    assert frozen == {
        ("2023_apr_4_r1", "pressure"): (10.3, 20.1),
        ("2023_apr_4_r2", "pressure"): (10.2, 20.1),
        ("2023_apr_4_r3", "pressure"): (10.2, 20.0),
        ("2023_apr_4_r5", "pressure"): (10.2, 20.1),
        ("2023_apr_4_r7", "pressure"): (10.3, 19.8),
    }


def test_asu_states_at_rest(asu: Path, arm: Robot, figure: Callable[[str], None]) -> None:
    """Four levels of 10 s: each ends with a rest whose means are those of its last seconds."""
    file = asu / "2023_jan4_r2.csv"
    rows, found = table(file), read_csv(file, "asu_two_segment", arm)
    states = rest_states(found)
    # The second level still creeps when it ends.
    assert [round(state.end) for state in states] == [10, 30, 40]
    for state in states:
        inside = (rows["t"] >= state.start) & (rows["t"] < state.end)
        measured = np.column_stack([rows[f"pm_{line}"] for line in LINES])
        measured = measured[inside & new_rows(measured)]
        np.testing.assert_allclose(state.pressure.value, measured.mean(axis=0))
        assert (state.pressure.deviation < 500.0).all()
        assert (state.of("tip").deviation[:3] < 5e-4).all()
        assert np.linalg.norm(state.of("tip").value[3:]) == pytest.approx(1.0)
        assert state.end - state.start >= 1.0
    runs = [read_csv(path, "asu_two_segment", arm) for path in sorted(asu.glob("2023_jan4*.csv"))]
    limits = still_limits(runs)
    number = sum(len(rest_states(run, limits)) for run in runs)
    bounds = f"{1e-3 * limits.pressure_pa:.2f} kPa and {1e3 * limits.position_m:.2f} mm a second"
    figure(f"asu_two_segment, jan4: {number} states at rest in 3 runs, within {bounds}")


def test_asu_a_rest_ends_where_pressures_freeze(asu: Path, arm: Robot) -> None:
    found = read_csv(asu / "2023_apr_4_r2.csv", "asu_two_segment", arm)
    assert not any(state.start < 19.9 and state.end > 10.5 for state in rest_states(found))
    assert not any(part.start < 19.9 and part.end > 10.5 for part in sections(found))


def test_asu_a_run_without_motion_is_rest_among_others(asu: Path, arm: Robot) -> None:
    still, moving = (
        read_csv(asu / f"{name}.csv", "asu_two_segment", arm) for name in ("2023_jan_10_1_r1", "2023_jan4_r1")
    )
    limits = still_limits([still, moving])
    (state,) = rest_states(still, limits)
    assert state.end - state.start > 39.0
    assert excited(still, limits) == ()
    assert decays(still, limits) == ()
    assert {part.kind for part in sections(still, still=limits)} == {"rest"}
    check_motion([still, moving])


def forced(tue: Path) -> Recording:
    return read_csv(tue / "forced_p123.csv", "tue_forced", load_robot("tue_three_bellow"))


def test_tue_forced_motion(tue: Path) -> None:
    rows, found = table(tue / "forced_p123.csv"), forced(tue)
    np.testing.assert_array_equal(found.pressure.values, np.column_stack([rows[f"p{k}"] for k in (1, 2, 3)]))
    bent = np.column_stack([rows["kx"], rows["ky"]])
    np.testing.assert_array_equal(found.curvatures[0].curvature, bent[new_rows(bent)])
    assert found.span == (0.0, 23.9984)
    # The pressures never stand still: two halves, of which one can be held out.
    (phase,) = excited(found)
    assert phase.duration > 23.0
    assert rest_states(found) == ()
    parts = sections(found)
    assert [part.kind for part in parts] == ["sweep", "sweep"]
    assert parts[0].end == parts[1].start == pytest.approx(12.0, abs=1e-3)
    assert hold_out(parts) == ((parts[0],), (parts[1],))


def test_tue_an_outlier_outside_the_stated_range_is_left_out(tue: Path) -> None:
    rows = table(tue / "forced_p123_spike.csv")
    found = read_csv(tue / "forced_p123_spike.csv", "tue_forced", load_robot("tue_three_bellow"))
    outside = int((np.abs(np.column_stack([rows["kx"], rows["ky"]])) > 20.0).any(axis=1).sum())
    assert found.faults[1].outside == outside
    assert np.abs(found.curvatures[0].curvature).max() <= 20.0


def test_tue_release(tue: Path) -> None:
    rows = table(tue / "release_17deg.csv")
    found = read_csv(tue / "release_17deg.csv", "tue_release", load_robot("tue_three_bellow"))
    bend = found.bends[0]
    np.testing.assert_allclose(np.degrees(bend.angle), rows["bend_deg"][new_rows(rows["bend_deg"][:, None])])
    assert found.is_stated
    assert (found.pressure.values == 0.0).all()
    (decay,) = decays(found)
    assert (decay.start, decay.end) == (0.0, pytest.approx(0.6))
    assert [part.kind for part in sections(found)] == ["release"]


def test_srl_steps(srl: Path, figure: Callable[[str], None]) -> None:
    """Stated levels, three markers; the frequency of each decay, by its spectrum, is that of the data set."""
    files = [(name, "srl_step_a") for name in sorted(srl.glob("step_A_*.csv"))]
    files += [(name, "srl_step_c") for name in sorted(srl.glob("step_C_*.csv"))]
    runs = [read_csv(path, at_once(columns), robot(1)) for path, columns in files]
    limits = still_limits(runs)
    assert len(runs) == 12
    for (path, _), found in zip(files, runs, strict=True):
        rows = table(path)
        level = 100.0 * float(path.stem[-7:-4])
        assert found.is_stated
        assert found.pressure.values.max() == level
        assert [marker.place.is_base for marker in found.markers] == [False] * 3
        for marker in found.markers:
            seen = np.column_stack([rows[f"{marker.name.removeprefix('c_')}_{axis}"] for axis in "xyz"])
            np.testing.assert_array_equal(marker.position, seen[new_rows(seen)])
    fill, vent = decays(runs[0], still_limits(runs[:1]))[-2:]
    assert (fill.start, vent.start) == (0.61, 3.6)
    vents = [decays(found, limits)[-1].start for found in runs[1:4]]
    assert vents == [3.81, 4.56, 5.52]
    frequencies = [ringing(found, vent_s) for found, vent_s in zip(runs[1:3], vents[:2], strict=True)]
    figure(f"srl_one_segment: decays after the vent ring at {', '.join(f'{f:.1f}' for f in frequencies)} Hz")
    # Of 200 and 300 mbar; the other two have 2 mm and half a second of it.
    assert frequencies == pytest.approx([8.0, 8.0], abs=0.5)
    text = summary(runs[0])
    assert "tip3 (the end of link 0): 99.5 Hz for 6.0 s, range 3.93 mm; 3 repeated of 600 samples" in text
    assert "stated" in text


def at_once(name: str) -> Columns:
    """Return a shipped column map without its assumed lags: a decay then begins with the motion."""
    columns = load(find_config(name, "recordings"), Columns)
    return with_changes(columns, pressures=with_changes(columns.pressures, stated_lag_s=(0.0, 0.0)))


def ringing(found: Recording, vent_s: float) -> float:
    """Return the frequency [Hz] of half a second after the vent, by crossings of the moving mean."""
    tip = next(marker for marker in found.markers if marker.name == "tip2").window(vent_s, vent_s + 1.0)
    t = np.arange(tip.t[0], tip.t[-1], 0.001)
    y = np.interp(t, tip.t, tip.position[:, 1])
    y = (y - np.convolve(y, np.ones(125) / 125, "same"))[100:500]
    crossings = np.flatnonzero(np.diff(np.sign(y)) != 0.0)
    return float(500.0 / np.diff(crossings).mean())
