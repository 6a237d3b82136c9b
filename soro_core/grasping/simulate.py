"""A squeeze in a simulated world: regulators that follow late, poses with noise, and the true forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.bodies import BodyWorld, WorldResult, WorldState, WorldStepper
from soro_core.errors import ModelError
from soro_core.grasping.squeeze import Felt, Squeeze, SqueezeState
from soro_core.model.checks import require


@dataclass(frozen=True)
class SqueezeRun:
    """What has happened, tick by tick.

    Attributes
    ----------
    t : ndarray (n_t,)
        [s]
    states : tuple of SqueezeState
        Of the hand.
    height_m : ndarray (n_t,)
        True height of the object in the world [m].
    normal_n : ndarray (n_t, n)
        True normal force between each finger and the object [N].
    """

    t: Array
    states: tuple[SqueezeState, ...]
    height_m: Array
    normal_n: Array


@dataclass(frozen=True)
class SqueezeTrial:
    """What a simulated hand measures, and how finely it is simulated.

    Attributes
    ----------
    tracked_m : float or None
        Standard deviation of the tracked height of the object [m]; None without one.
    has_pose : bool
        Whether fingers have poses.
    tick_s, step_s, lag_s : float
        Of hand, of world, and time constant of the regulators [s].
    seed : int
        Of the noise.
    """

    tracked_m: float | None = 5e-5
    has_pose: bool = True
    tick_s: float = 0.01
    step_s: float = 5e-4
    lag_s: float = 0.05
    seed: int = 0


def simulate_squeeze(
    world: BodyWorld,
    squeeze: Squeeze,
    body: str,
    *,
    t_end: float,
    closes: Callable[[float], bool] = lambda t: True,
    trial: SqueezeTrial | None = None,
) -> SqueezeRun:
    """Simulate a hand around a body; the run ends early where the world does, or the body leaves it.

    Parameters
    ----------
    world : BodyWorld
        Its arms are the fingers, in their order; they need not be the models of the hand.
    squeeze : Squeeze
    body : str
        The object.
    t_end : float
        [s]
    closes : callable
        Whether the hand is to hold, by the time [s].
    trial : SqueezeTrial, optional

    Raises
    ------
    ModelError
        If there is no such body, or arms and fingers are not as many.
    """
    require(squeeze, Squeeze, "squeeze", "a Squeeze")
    if body not in world.bodies:
        raise ModelError(f"body = {body}: allowed are {', '.join(world.bodies)}", "body")
    if len(world.arms) != len(squeeze.fingers):
        raise ModelError(f"{len(world.arms)} arms: allowed are {len(squeeze.fingers)}, one a finger", "arms")
    trial = trial or SqueezeTrial()
    tick_s = trial.tick_s
    random, stepper = np.random.default_rng(trial.seed), WorldStepper(world, trial.step_s)
    now, hand, b = stepper.initial_state(), squeeze.initial_state(), list(world.bodies).index(body)
    pressure = {name: np.zeros(arm.n_u) for name, arm in world.arms.items()}
    times, states, heights, normals = [], [], [], []
    for k in range(round(t_end / tick_s)):
        q = [
            now.arms[name].q + one.noise * random.standard_normal(one.arm.n_q) if trial.has_pose else None
            for name, one in zip(world.arms, squeeze.fingers, strict=True)
        ]
        height = float(now.place[b, 2])
        seen = None if trial.tracked_m is None else height + trial.tracked_m * float(random.standard_normal())
        hand = squeeze.step(hand, Felt(list(pressure.values()), q, seen), closes(k * tick_s), tick_s)
        wanted = dict(zip(world.arms, squeeze.pressures(hand), strict=True))
        after = {
            name: p + (1.0 - np.exp(-tick_s / trial.lag_s)) * (wanted[name] - p)
            for name, p in pressure.items()
        }
        result = stepper.step(
            now, {name: np.array([pressure[name], after[name]]) for name in after}, tick_s, k * tick_s
        )
        if not result.status.ok:
            break
        now, pressure = WorldState.last_of(result), after
        times.append((k + 1) * tick_s)
        states.append(hand)
        heights.append(float(now.place[b, 2]))
        normals.append(finger_normals(result, b))
    return SqueezeRun(
        np.array(times), tuple(states), np.array(heights), np.array(normals).reshape(len(times), -1)
    )


def finger_normals(result: WorldResult, body: int) -> Array:
    """Return the normal force between each arm and a body in the last step, (n_arms,) [N]."""
    rows, found = result.contacts, np.zeros(len(result.q))
    last = rows.step == len(result.t) - 1
    for side, force, normal in zip(rows.side[last], rows.force[last], rows.normal[last], strict=True):
        if body in side and min(side) < 0:
            found[-1 - int(min(side))] += abs(float(force @ normal))
    return found
