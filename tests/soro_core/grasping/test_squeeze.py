"""A hand that squeezes what it does not know: its force, its limit, and what it does about a slip."""

import numpy as np
import pytest

from soro_core.bodies import BallShape, BodyMotion, BodyWorld, BoxShape, RigidBody, simulate_world
from soro_core.errors import ConfigError
from soro_core.frozen import replaced
from soro_core.grasping import Felt, Finger, Squeeze, SqueezeSettings, SqueezeTrial, simulate_squeeze
from soro_core.grasping.finger import FingerForce
from soro_core.model.equilibrium.statics import equilibrium
from tests.soro_core.bodies.scenes import WEIGHT, fingers

NOISE = np.array([1.5e-3, 0.05, 0.05])
CLOSING = np.array([1.0, 0.0, 0.0])
BEGIN, END = 2.5, 11.0
# Place without load: fingers of an open hand are longer by 8 %, and touch below the middle of the ball.
TOUCH = 0.06


def hand(noise=NOISE, **settings):
    models = [Finger(arm, CLOSING, TOUCH, noise) for arm in fingers().values()]
    return Squeeze(models, SqueezeSettings(**settings))


def on_table(mass=0.02, friction=0.6, radius=0.016, is_there=True, arms=None):
    """A ball between fingers, on a table that sinks by 6 mm within 6 s, and then away."""
    motion = BodyMotion(
        at_s=(BEGIN, BEGIN + 6.0, BEGIN + 7.0),
        displacement_m=(0.0, 0.0, 0.0, 0.0, 0.0, -0.006, 0.0, 0.0, -0.036),
    )
    high = -0.06 if is_there else -0.2
    ball = RigidBody(shape=BallShape(radius=radius), mass=mass, friction=friction, position=[0.0, 0.0, high])
    at = [0.0, 0.0, high - radius - 0.01]
    table = RigidBody(shape=BoxShape(size=[0.02] * 3), fixed=True, position=at, motion=motion)
    return BodyWorld({"object": ball, "table": table}, arms or fingers(), points_per_link=9)


def phases(run):
    names = [state.phase for state in run.states]
    return [name for name, before in zip(names, ["", *names], strict=False) if name != before]


def test_force_of_a_finger_is_that_of_the_contact():
    """Against the truth of a world where the tip of the finger leans on a block without friction."""
    arm = fingers(1)["finger0"]
    block = RigidBody(
        shape=BoxShape(size=[0.02, 0.1, 0.01]), fixed=True, position=[0.005, 0.0, -0.062], friction=0.0
    )
    pressure = np.array([40e3, 0.0, 0.0])
    result = simulate_world(
        BodyWorld({"block": block}, {"finger": arm}), t_end=1.5, pressures={"finger": pressure}
    )
    truth = result.normal_force("finger")[-1]
    felt = Finger(arm, CLOSING, arm.length, NOISE).feel(result.q["finger"][-1], pressure)
    assert truth > 0.05
    assert felt.squeeze_n == pytest.approx(truth, rel=0.08)
    assert felt.across_n == pytest.approx(felt.squeeze_n)


def test_a_finger_that_bends_in_one_plane_feels_what_is_across_it():
    """A PneuNet has one coordinate: a force along it does not bend it."""
    arm = fingers(1, robot="pneunet_finger")["finger0"]
    block = RigidBody(
        shape=BoxShape(size=[0.02, 0.1, 0.01]), fixed=True, position=[0.010, 0.0, -0.058], friction=0.0
    )
    pressure = np.array([12e3])
    result = simulate_world(
        BodyWorld({"block": block}, {"finger": arm}), t_end=1.5, pressures={"finger": pressure}
    )
    truth = result.normal_force("finger")[-1]
    felt = Finger(arm, np.ones(1), arm.length, np.zeros(1)).feel(result.q["finger"][-1], pressure)
    assert truth > 0.02
    assert felt.squeeze_n == pytest.approx(truth, rel=0.1)
    assert felt.squeeze_n == pytest.approx(felt.bend_n)
    assert felt.across_n == pytest.approx(felt.squeeze_n)
    assert felt.along_n == pytest.approx(0.0, abs=1e-15)


def test_pneunets_of_finite_elements_hold_a_ball_whose_weight_they_are_not_told():
    arms = fingers(radius=0.032, robot="pneunet_finger")
    world = on_table(0.01, 0.8, arms=arms)
    settings = SqueezeSettings(
        most_pa=25e3, open_part=0.0, close_pa_s=8e3, crush_n=0.6, pa_per_n=1e5, rise_pa_s=10e3, touch_pa=5e3
    )
    models = [Finger(arm, np.ones(1), 0.056, np.zeros(1)) for arm in arms.values()]
    run = simulate_squeeze(world, Squeeze(models, settings), "object", t_end=END)
    held = run.height_m[-1]
    assert phases(run)[-1] == "holding"
    assert -0.068 < held < -0.058
    assert 0.01 * WEIGHT / 0.8 < run.normal_n[-1].sum() < 1.5 * 0.01 * WEIGHT / 0.8


def test_a_finger_in_the_air_feels_nothing():
    arm = fingers(1)["finger0"]
    pressure = np.array([30e3, 5e3, 0.0])
    felt = Finger(arm, CLOSING, 0.062, NOISE).feel(equilibrium(arm, pressure), pressure)
    assert abs(felt.squeeze_n) < 1e-6
    assert abs(felt.along_n) < 1e-6


def test_a_ball_is_held_by_little_more_than_its_weight_needs():
    mass, friction = 0.02, 0.6
    run = simulate_squeeze(
        on_table(mass, friction),
        hand(force_n=0.01),
        "object",
        t_end=END + 8.0,
        trial=SqueezeTrial(step_s=1e-3, tick_s=0.02),
    )
    order = [phases(run).index(one) for one in ("closing", "squeezing", "holding", "slipping")]
    assert order == sorted(order)
    # Noise is no slip: what is held is squeezed no harder.
    late = run.t > END
    assert {state.phase for state in np.array(run.states)[late]} == {"holding"}
    assert np.ptp(run.height_m[late]) < 1e-6
    assert np.ptp(run.normal_n[late].sum(axis=1)) < 1e-3 * run.normal_n[-1].sum()
    needed = mass * WEIGHT / friction
    # The first squeeze is too weak: it has slipped, and no more than it must.
    at_first = run.normal_n[round(BEGIN * 50)].sum()
    assert at_first < 0.5 * needed
    assert run.normal_n.sum(axis=1).max() < 1.3 * needed


@pytest.mark.parametrize(("open_part", "is_held"), [(1.0 / 3.0, True), (0.0, False)])
def test_a_heavy_ball_is_held_by_fingers_that_keep_their_length(open_part, is_held):
    """Fingers that get longer take it down with them, where the largest pressure is too little."""
    run = simulate_squeeze(
        on_table(mass=0.045, friction=0.5),
        hand(force_n=0.01, crush_n=0.6, open_part=open_part),
        "object",
        t_end=END,
        trial=SqueezeTrial(step_s=1e-3),
    )
    assert bool(run.height_m[-1] > -0.068) == is_held


@pytest.mark.parametrize(("still_s", "rate_pa_s"), [(0.0, 20e3), (0.1, 0.0)])
def test_what_no_longer_sinks_is_squeezed_no_harder_whatever_the_goal(still_s, rate_pa_s):
    law = hand(noise=np.zeros(3), force_n=0.01, crush_n=10.0)
    level = 20e3
    pressures = [law.settings.pressures(CLOSING, level)] * 3
    felt = Felt(pressures, [0.5 * equilibrium(law.fingers[0].arm, pressures[0])] * 3, 0.0)
    level_pa = np.full(3, level)
    state = replaced(law.initial_state(), phase="slipping", level_pa=level_pa, goal_n=5.0, still_s=still_s)
    after = law.step(state, felt, True, 0.01)
    assert after.phase == "slipping"
    assert (after.level_pa.mean() - level) / 0.01 == pytest.approx(rate_pa_s)


@pytest.mark.parametrize(("sinks", "slides", "slips"), [(1, 0, False), (0, 1, False), (1, 1, True)])
def test_it_slips_where_it_sinks_in_the_world_and_against_the_fingers(sinks, slides, slips):
    """A finger that gets longer takes it down; one that bends up leaves it where it is."""
    law = hand(noise=np.zeros(3), force_n=0.01, crush_n=10.0)
    pressures = [law.settings.pressures(CLOSING, 20e3)] * 3
    state = replaced(law.initial_state(), phase="holding", level_pa=np.full(3, 20e3), held_n=10.0)
    phases = set()
    for k in range(200):
        fall = 1e-3 * max(k - 60, 0) * 0.01
        # The pose at which the place of touch has come down by what the object does not slide on it.
        shape = np.array([fall * (sinks - slides) / TOUCH, 0.0, 0.0])
        state = law.step(state, Felt(pressures, [shape] * 3, -fall * sinks), True, 0.01)
        phases.add(state.phase)
    assert ("slipping" in phases) == slips


def test_the_sum_of_pressures_stays_while_one_chamber_of_three_closes():
    law = hand(most_pa=90e3)
    for level in (0.0, 45e3, 90e3):
        pressures = law.settings.pressures(CLOSING, level)
        assert pressures.sum() == pytest.approx(90e3)
        assert pressures[0] - pressures[1] == pytest.approx(level)


def test_untracked_the_same_weak_squeeze_loses_the_ball():
    """That the ball above is held is due to the slip that is seen."""
    run = simulate_squeeze(
        on_table(), hand(force_n=0.01), "object", t_end=END, trial=SqueezeTrial(step_s=1e-3, tracked_m=None)
    )
    assert run.height_m[-1] < -0.075


@pytest.mark.parametrize("has_pose", [True, False])
def test_a_firm_squeeze_holds_an_untracked_ball(has_pose):
    run = simulate_squeeze(
        on_table(),
        hand(force_n=0.12),
        "object",
        t_end=END,
        trial=SqueezeTrial(step_s=1e-3, tracked_m=None, has_pose=has_pose),
    )
    assert run.height_m[-1] > -0.068
    assert run.states[-1].phase == "holding"
    assert "slipping" not in phases(run)
    if (
        has_pose
    ):  # A lift takes force away, and is no slip: the force that was asked for is kept, and no more.
        assert run.normal_n[run.t > END - 1.0].mean() == pytest.approx(0.12, rel=0.15)


def test_no_finger_passes_the_crush_limit():
    """A ball that would need four times as much is lost rather than crushed."""
    crush = 0.06
    run = simulate_squeeze(
        on_table(mass=0.05),
        hand(force_n=0.01, crush_n=crush),
        "object",
        t_end=END,
        trial=SqueezeTrial(step_s=1e-3),
    )
    assert run.normal_n.max() < crush
    assert run.normal_n.max() > 0.5 * crush
    assert run.height_m[-1] < -0.075
    causes = {state.cause for state in run.states} - {""}
    assert causes == {"the object is gone, the crush limit is too low to hold it"}


def test_a_hand_that_meets_nothing_opens_and_says_so():
    run = simulate_squeeze(
        on_table(is_there=False),
        hand(most_pa=30e3),
        "object",
        t_end=8.0,
        trial=SqueezeTrial(step_s=1e-3),
        closes=lambda t: t < 7.0,
    )
    assert "closing" in phases(run)
    assert "touching" not in phases(run)
    assert any(state.cause == "a finger has met nothing" for state in run.states)
    # Asked to be open once, it may close again.
    assert run.states[-1].phase == "open"
    assert run.states[-1].cause == ""


def test_the_hand_opens_when_it_is_asked_to():
    run = simulate_squeeze(
        on_table(), hand(), "object", t_end=4.0, trial=SqueezeTrial(step_s=1e-3), closes=lambda t: t < 2.0
    )
    assert phases(run)[-2:] == ["opening", "open"]
    assert (run.states[-1].level_pa == 0.0).all()
    assert run.normal_n[-1].max() == 0.0


def test_lost_force_while_the_pressures_hold_is_a_slip():
    law = hand(noise=np.zeros(3), force_n=0.05, crush_n=1.0)
    arm, level = law.fingers[0].arm, 30e3
    free = equilibrium(arm, level * CLOSING)
    pressure = [level * CLOSING] * 3

    def at(part):
        """The finger a part of the way to where it would be without contact: less force the nearer it is."""
        return Felt(pressure, [part * free] * 3)

    state = replaced(
        law.initial_state(), phase="holding", level_pa=np.full(3, level), touches=np.ones(3, bool)
    )
    for _ in range(100):
        state = law.step(state, at(0.3), True, 0.01)
    held = state.force_n.mean()
    assert state.phase == "holding"
    for _ in range(100):
        state = law.step(state, at(0.6), True, 0.01)
        if state.phase == "slipping":
            break
    assert state.phase == "slipping"
    assert state.force_n.mean() < 0.85 * held
    low = state.goal_n
    for _ in range(100):
        state = law.step(state, at(0.6), True, 0.01)
    assert state.goal_n == pytest.approx(low * np.exp(1.0 / 3.0), rel=0.01)
    assert state.level_pa.mean() > level


@pytest.mark.parametrize("speed", [5e-4, 2e-3])
def test_the_force_rises_by_a_factor_e_for_a_length_of_slip(speed):
    """However fast it slips; and for a time where nothing tracks it."""
    law = hand(noise=np.zeros(3), force_n=0.01, crush_n=10.0, slip_m=2e-3, blind_s=4.0)
    level, rises = 20e3, {}
    free = equilibrium(law.fingers[0].arm, level * CLOSING)
    for is_tracked in (True, False):
        state = replaced(law.initial_state(), phase="slipping", level_pa=np.full(3, level), held_n=10.0)
        goals = []
        for k in range(300):
            height = -speed * 0.01 * k if is_tracked else None
            state = law.step(state, Felt([level * CLOSING] * 3, [0.5 * free] * 3, height), True, 0.01)
            goals.append(state.goal_n)
        assert state.phase == "slipping"
        rises[is_tracked] = np.log(goals[299] / goals[199])
    assert rises[True] == pytest.approx(speed / 2e-3, rel=0.02)
    assert rises[False] == pytest.approx(1.0 / 4.0)


def test_in_a_slip_the_pressures_rise_slowly_and_near_the_crush_limit_more_so():
    level = 20e3
    finger = hand(noise=np.zeros(3)).fingers[0]
    pressure, shape = level * CLOSING, 0.5 * equilibrium(finger.arm, level * CLOSING)
    felt = finger.feel(shape, pressure)
    most = felt.across_n + felt.doubt_n
    assert felt.doubt_n > 0.1 * felt.across_n
    rates = {}
    for room in (1.0, 0.01, -0.01):
        law = hand(noise=np.zeros(3), force_n=0.01, crush_n=most + room, crush_part=1.0)
        state = replaced(
            law.initial_state(), phase="slipping", level_pa=np.full(3, level), goal_n=5.0, still_s=0.0
        )
        after = law.step(state, Felt([pressure] * 3, [shape] * 3, 0.0), True, 0.01)
        assert after.most_n == pytest.approx(most)
        rates[room] = (after.level_pa.max() - level) / 0.01
    assert rates[1.0] == pytest.approx(law.settings.rise_pa_s)
    assert rates[0.01] == pytest.approx(0.01 * law.settings.pa_per_n / (10.0 * law.settings.filter_s))
    assert rates[-0.01] == pytest.approx(-law.settings.close_pa_s)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"force_n": 0.5}, "none above the next one"),
        ({"touch_pa": 1e5}, "at most most_pa"),
        ({"open_part": 1.0}, "open_part"),
        ({"slip_m": 0.0}, "slip_m"),
    ],
)
def test_bad_settings_are_refused_in_one_line(keys, said):
    with pytest.raises(ConfigError, match=said) as error:
        SqueezeSettings(**keys)
    assert "\n" not in str(error.value)


def test_bad_fingers_and_measurements_are_refused():
    arm = fingers(1)["finger0"]
    for closing, place, noise, said in (
        ([1.0, 0.0], 0.06, NOISE, "closing"),
        ([0.5, 0.0, 0.0], 0.06, NOISE, "closing"),
        (CLOSING, 0.07, NOISE, "touch_m"),
        (CLOSING, 0.06, -NOISE, "noise"),
    ):
        with pytest.raises(ConfigError, match=said):
            Finger(arm, np.array(closing), place, noise)
    with pytest.raises(ConfigError, match="two or more"):
        Squeeze([Finger(arm, CLOSING, 0.06, NOISE)], SqueezeSettings())
    law = hand()
    with pytest.raises(ConfigError, match="finite"):
        law.step(law.initial_state(), Felt([np.zeros(3)] * 3, [np.full(3, np.nan)] * 3), True, 0.01)
    with pytest.raises(ConfigError, match="finite"):
        law.step(law.initial_state(), Felt([np.zeros(3)] * 3, [np.zeros(3)] * 3, np.nan), True, 0.01)
    with pytest.raises(ConfigError, match="3 fingers"):
        law.step(law.initial_state(), Felt([np.zeros(3)] * 2, [None] * 2), True, 0.01)


@pytest.mark.parametrize("strain", [1e200, np.nan])
def test_a_force_that_is_no_number_opens_the_hand(strain, monkeypatch):
    """No limit is below it: the pressures would rise for ever."""
    law = hand(noise=np.zeros(3), force_n=0.05)
    rest = Felt([np.zeros(3)] * len(law.fingers), [np.zeros(3)] * len(law.fingers))
    state = law.step(law.initial_state(), rest, True, 0.01)
    assert state.phase == "closing"
    if np.isfinite(strain):
        rest = replaced(rest, q=[np.full(3, strain)] * len(law.fingers))
    else:
        monkeypatch.setattr(Finger, "feel", lambda *of: FingerForce(*[strain] * 5, np.zeros(3)))
    for _ in range(3):
        state = law.step(state, rest, True, 0.01)
    assert (state.phase, state.cause) == ("open", "the model of a finger gives no finite force")
    assert not state.level_pa.any()
