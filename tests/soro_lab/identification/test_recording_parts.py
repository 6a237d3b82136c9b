"""States at rest, decays and sections of made recordings whose truth is known."""

import itertools

import numpy as np
import pytest
from made_recordings import CHAMBERS, robot

from soro_core.errors import ConfigError, ModelError
from soro_lab.identification.recording import (
    Bend,
    Curvature,
    Marker,
    Place,
    Plate,
    Recording,
    SectionLimits,
    Series,
    StillLimits,
    check_motion,
    decays,
    excited,
    hold_out,
    moves,
    place_of_part,
    rest_states,
    sections,
    still_limits,
    without_hands,
)
from tests.refused import fails, refused

LIMITS = StillLimits(pressure_pa=500.0, position_m=3e-4, curvature_per_m=0.05, bend_rad=5e-3)
NOISE_PA, NOISE_M = 300.0, 2e-4
EDGES = (0.0, 4.0, 8.0, 12.0)
LEVELS = (0.0, 20e3, 50e3, 10e3)


def stepped(seed: int = 2, ring: float = 0.0, end: float = 16.0) -> Recording:
    """Four levels of 4 s with a lag of 50 ms; the tip moves 1 mm a kPa, rings at 3 Hz, and has noise."""
    rng = np.random.default_rng(seed)
    t, seen = np.arange(0.0, end, 0.01), np.arange(0.003, end, 0.02)

    def tip(at: np.ndarray) -> np.ndarray:
        value = np.zeros(len(at))
        for edge, step in zip(EDGES, np.diff((0.0, *LEVELS)), strict=True):
            since = np.clip(at - edge, 0.0, None)
            swing = ring * np.exp(-2.0 * since) * np.cos(2 * np.pi * 3.0 * since)
            value += 1e-6 * step * (at >= edge) * (1.0 - np.exp(-since / 0.05) - swing)
        return value

    pressure = np.zeros(len(t))
    for edge, step in zip(EDGES, np.diff((0.0, *LEVELS)), strict=True):
        pressure += step * (t >= edge) * (1.0 - np.exp(-np.clip(t - edge, 0.0, None) / 0.05))
    measured = np.column_stack([pressure, np.zeros(len(t))]) + NOISE_PA * rng.standard_normal((len(t), 2))
    position = np.zeros((len(seen), 3))
    position[:, 0] = tip(seen)
    position += NOISE_M * rng.standard_normal(position.shape)
    turn = np.column_stack([0.5 * position[:, :1], np.zeros((len(seen), 2)), np.ones((len(seen), 1))])
    turn /= np.linalg.norm(turn, axis=1)[:, None] * np.where(np.arange(len(seen)) % 2, 1.0, -1.0)[:, None]
    return Recording(
        name="stepped",
        chambers=CHAMBERS,
        pressure=Series("pressure", t, measured),
        plates=(Plate("tip", seen, Place(1), position, turn),),
        markers=(Marker("dot", seen, Place(0), 0.4 * position),),
    )


def released(amplitude: float) -> Recording:
    """A curvature [1/m] that is let go after 4 s, and rings with 1/3 s."""
    t = np.arange(0.0, 10.0, 0.01)
    since = np.clip(t - 4.0, 0.0, None)
    curvature = np.column_stack(
        [amplitude * np.exp(-3.0 * since) * np.cos(20.0 * since) * (t > 4.0), 0.0 * t]
    )
    return Recording(
        "release",
        CHAMBERS,
        Series("pressure", t, np.full((len(t), 2), 1e3)),
        curvatures=(Curvature("bent", t, 0, curvature),),
    )


def test_states_at_rest_are_the_levels() -> None:
    """Each mean lies within four of its stated deviations of the truth, and these are those of the noise."""
    recording = stepped()
    states = rest_states(recording, LIMITS)
    assert len(states) == 4
    for state, edge, level in zip(states, EDGES, LEVELS, strict=True):
        assert edge <= state.start < edge + 1.5
        assert state.end == pytest.approx(edge + 4.0, abs=0.3)
        off = np.abs(state.pressure.value - [level, 0.0])
        assert (off < 4.0 * state.pressure.deviation).all()
        assert state.pressure.deviation == pytest.approx(NOISE_PA / np.sqrt(state.pressure.samples), rel=0.9)
        tip = state.of("tip")
        assert (np.abs(tip.value[:3] - [1e-6 * level, 0.0, 0.0]) < 4.0 * tip.deviation[:3] + 1e-6).all()
        half = np.arctan(0.5e-6 * level)
        np.testing.assert_allclose(np.abs(tip.value[3:]), [np.sin(half), 0.0, 0.0, np.cos(half)], atol=1e-4)
        np.testing.assert_allclose(state.of("dot").value, 0.4 * tip.value[:3], atol=1e-12)
    assert states[0].of("other") is None


def test_slow_drift_is_no_rest_and_widens_the_deviation() -> None:
    """A quarter of a second shows no drift of 0.8 mm/s, a second does; below the limit it is stated."""
    recording = stepped(end=4.0)
    plate = recording.plates[0]
    for speed, is_rest in ((8e-4, False), (1e-4, True)):
        position = plate.position + np.outer(speed * plate.t, [0.0, 1.0, 0.0])
        drifting = Plate("tip", plate.t, plate.place, position, plate.quaternion)
        found = rest_states(Recording("drift", CHAMBERS, recording.pressure, plates=(drifting,)), LIMITS)
        assert bool(found) == is_rest
    (state,) = found
    assert state.of("tip").deviation[1] > 2.0 * state.of("tip").deviation[2]


def test_limits_are_parts_of_the_ranges_of_all_recordings() -> None:
    small = stepped(end=4.0)
    limits = still_limits([stepped(), small], pressure=0.02, shape=0.01)
    assert limits.pressure_pa == pytest.approx(0.02 * 50e3, rel=0.05)
    assert limits.position_m == pytest.approx(0.01 * 0.05, rel=0.05)
    assert (limits.curvature_per_m, limits.bend_rad) == (0.0, 0.0)
    assert still_limits([small]).position_m < 0.1 * limits.position_m


def test_a_decay_begins_where_the_pressures_are_those_of_its_end() -> None:
    """Rings with 1/2 s after each step; the pressures need 0.2 s for the last per cent."""
    found = decays(stepped(ring=0.6), LIMITS)
    assert [round(phase.start) for phase in found] == [4, 8, 12]
    for phase, edge, step in zip(found, EDGES[1:], np.abs(np.diff(LEVELS)), strict=True):
        settled = 0.05 * np.log(step / 500.0)
        assert 0.2 * settled < phase.start - edge < settled + 0.06
        assert 0.5 < phase.duration < 3.5
    assert decays(stepped(ring=0.0, end=4.0), LIMITS) == ()


def test_excited_stretches_are_those_of_the_steps() -> None:
    found = excited(stepped(), LIMITS)
    assert [round(phase.start) for phase in found] == [4, 8, 12]
    assert all(phase.start <= edge + 1e-6 < phase.end for phase, edge in zip(found, EDGES[1:], strict=True))
    assert all(phase.duration <= 1.0 for phase in found)
    together = excited(stepped(), LIMITS, pause_s=5.0)
    assert [(round(phase.start), round(phase.end)) for phase in together] == [(4, 13)] or len(together) == 1


def test_sections_begin_at_rest_and_hold_one_motion_each() -> None:
    parts = sections(stepped(), still=LIMITS)
    assert [part.kind for part in parts] == ["rest", "step", "step", "step"]
    assert parts[0].start == pytest.approx(0.003)
    for part, edge in zip(parts[1:], EDGES[1:], strict=True):
        assert part.starts_at_rest
        assert edge - 1.0 < part.start < edge
        assert part.end - part.start > 2.5
    for one, other in itertools.pairwise(parts):
        assert one.end == other.start
    kept, out = hold_out(parts)
    assert out == (parts[2],)  # the second of the steps; the only rest stays
    assert kept == (parts[0], parts[1], parts[3])
    assert hold_out(parts, every=1) == ((parts[0], parts[1]), parts[2:])


def test_sections_end_at_gaps_and_long_ones_are_cut() -> None:
    """Pressures missing for 5 s belong to no section; a sweep of 20 s becomes parts of equal length."""
    t = np.arange(0.0, 40.0, 0.02)
    t = t[(t < 10.0) | (t > 15.0)]
    values = 1e4 * np.column_stack([np.sin(t), np.cos(t)])
    seen = np.arange(0.0, 40.0, 0.02)
    bend = Bend("bend", seen, 0, np.sin(seen))
    recording = Recording("sweep", CHAMBERS, Series("pressure", t, values), bends=(bend,))
    parts = sections(recording, SectionLimits(longest_s=10.0))
    found = [(round(part.start, 1), round(part.end, 1), part.kind) for part in parts]
    assert found[0] == (0.0, 10.0, "sweep")
    assert [start for start, _, _ in found[1:]] == pytest.approx([15.0, 23.3, 31.7], abs=0.1)
    assert {kind for _, _, kind in found} == {"sweep"}
    assert not any(part.starts_at_rest for part in parts)
    kept, out = hold_out(parts)
    assert (len(kept), out) == (3, (parts[1],))


@pytest.mark.parametrize(("seconds", "number"), [(8.0, 1), (12.0, 2)])
def test_a_single_sweep_is_cut_in_two_so_that_one_half_can_be_held_out(seconds: float, number: int) -> None:
    t = np.arange(0.0, seconds, 0.02)
    moving = 1e4 * np.column_stack([np.sin(t), np.cos(t)])
    bend = Bend("bend", t, 0, np.sin(t))
    recording = Recording("sweep", CHAMBERS, Series("pressure", t, moving), bends=(bend,))
    parts = sections(recording)
    assert [part.kind for part in parts] == ["sweep"] * number
    assert len(hold_out(parts)[1]) == number - 1
    assert parts[0].end - parts[0].start == pytest.approx(t[-1] / number)


def test_a_release_is_a_section_of_its_own() -> None:
    """Constant pressures, a tip that a person bends and lets go, and rest at both ends."""
    recording = released(3.0)
    parts = sections(recording, SectionLimits(longest_s=60.0), LIMITS)
    assert [part.kind for part in parts] == ["rest", "release"]
    (decay,) = decays(recording, LIMITS)
    assert decay.start == pytest.approx(4.0, abs=0.011)
    assert 4.5 < decay.end < 6.5
    # A motion of less than 20 limits is none.
    assert decays(released(0.5), LIMITS) == ()


def test_the_time_in_which_a_hand_holds_the_arm_is_cut_out() -> None:
    """Rest to 3 s, a hand bends the arm and holds it with a tremor, lets go at 6 s; it rings and rests."""
    t = np.arange(0.0, 12.0, 0.01)
    taken, since = np.clip(t - 3.0, 0.0, 1.0), np.clip(t - 6.0, 0.0, None)
    held = 3.0 * taken - 0.4 * np.sin(7.0 * t) ** 2 * (t > 4.0)
    kappa = np.where(t < 6.0, held, held[599] * np.exp(-3.0 * since) * np.cos(20.0 * since))
    curvature = np.column_stack([kappa, 0.0 * t])

    def seen(curvature: np.ndarray) -> Recording:
        pressure = Series("pressure", t, np.full((len(t), 2), 1e3))
        return Recording("hand", CHAMBERS, pressure, curvatures=(Curvature("bent", t, 0, curvature),))

    before, after = without_hands(seen(curvature), LIMITS)
    assert before.name == "hand"
    assert before.span == pytest.approx((0.0, 3.0), abs=0.3)
    assert after.name.startswith("hand, let go at ")
    start, end = after.span
    # The last sample as far out as any: the tremor moves it by 0.4 of 3 1/m at most.
    assert 5.4 < start < 6.01
    assert end == pytest.approx(t[-1])
    assert sections(after, still=LIMITS)[0].kind == "release"
    # A hand that never lets go: only the time before it is left.
    (before,) = without_hands(seen(np.column_stack([held, 0.0 * t])), LIMITS)
    assert before.span == pytest.approx((0.0, 3.0), abs=0.3)


@pytest.mark.parametrize("recording", [stepped(), stepped(ring=0.6)])
def test_what_no_hand_touches_stays_whole(recording: Recording) -> None:
    assert without_hands(recording, LIMITS) == (recording,)


def test_windows_and_shifts_keep_the_rest_of_a_recording() -> None:
    recording = stepped()
    part = recording.window(4.0, 8.0)
    for stream in part.streams:
        assert (stream.t >= 4.0).all()
        assert (stream.t < 8.0).all()
        assert stream.table().shape[0] == stream.t.size > 100
    np.testing.assert_array_equal(part.plates[0].position[0], recording.plates[0].position[200])
    assert part.plates[0].place == Place(1)
    later = recording.shifted("tip", 0.125)
    np.testing.assert_allclose(later.plates[0].t - recording.plates[0].t, 0.125)
    assert later.pressure is recording.pressure
    assert later.markers is not None
    np.testing.assert_array_equal(later.markers[0].t, recording.markers[0].t)
    with fails(ConfigError, "pressure", "tip", "dot", where="stepped", key="stream"):
        recording.shifted("plate", 0.1)
    np.testing.assert_allclose(
        Series("p", np.array([0.0, 1.0]), np.array([[0.0, 4.0], [2.0, 0.0]])).at(np.array([-1.0, 0.25, 9.0])),
        [[0.0, 4.0], [0.5, 3.0], [2.0, 0.0]],
    )


def test_recordings_without_motion_are_refused() -> None:
    """Noise is no motion; one recording at rest among others is welcome."""
    resting, moving = stepped(end=4.0), stepped()
    assert not moves(resting.plates[0])
    assert moves(moving.plates[0])
    check_motion([resting, moving])
    with refused(key="", got="no motion") as caught:
        check_motion([resting, resting])
    assert caught.value.where == "stepped, stepped"
    with refused(key=""):
        check_motion([])


def test_places_on_the_arm() -> None:
    """Parts of the length as scenes state them, and metres along the arm as the model takes them."""
    arm = robot(3)
    for part, place, along in (
        (0.0, Place(0, 0.0), 0.0),
        (1 / 3, Place(0), 0.1),
        (0.5, Place(1, 0.05), 0.15),
        (1.0, Place(2), 0.3),
    ):
        found = place_of_part(arm, part)
        assert (found.link, found.s is None) == (place.link, place.s is None)
        assert found.along(arm) == pytest.approx(along)
    assert Place(0, 0.0).is_base
    assert not Place(0).is_base
    # An end follows the length of a link, a place within a link does not.
    longer = arm.replace(links=[{**link.model_dump(), "length": 0.2} for link in arm.links])
    assert (Place(1).along(longer), Place(1, 0.05).along(longer)) == (pytest.approx(0.4), pytest.approx(0.25))
    with fails(ModelError, "0 to 2", key="link"):
        Place(3).along(arm)
    with fails(ModelError, "0.1", key="s"):
        Place(0, 0.2).along(arm)
