"""From a scene and options to the sensors that are chosen for its motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.config import parse, with_changes
from soro_core.control.config import require_chambers
from soro_core.errors import ConfigError
from soro_core.estimation import Estimator
from soro_core.model import SoftArm
from soro_core.model.discretised import discretised
from soro_lab.analysis.equilibrium_paths import place_at, rest_pressure, targets
from soro_lab.analysis.gramian import gramian, windows
from soro_lab.analysis.placement import Information, best, greedy
from soro_lab.analysis.sensors import SensorCandidate, SensorNoise, kinds_of, noise_of
from soro_lab.analysis.stiffness import tip_jacobian
from soro_lab.scene import Scene
from soro_lab.trade.closed_loop import drive

# Bounds of the time that stands for one period of the slowest mode that swings [s].
SHORTEST_S, LONGEST_S = 0.05, 1.0


def slowest_period(arm: SoftArm) -> float:
    """Return the period [s] of the slowest mode about rest that swings, within bounds."""
    low, high = arm.robot.pressure_range_pa
    modes = place_at(arm, np.full(arm.n_u, rest_pressure(low, high))).modes
    swings = modes.damped_hz[modes.damped_hz > 0.0]
    period = 1.0 / swings.min() if swings.size else LONGEST_S
    return float(min(max(period, SHORTEST_S), LONGEST_S))


def excursions(arm: SoftArm, dt: float, period_s: float) -> list[Array]:
    """Return pressures (n_ticks, n_u) [Pa] of the motions: up, hold, down and hold, two periods each.

    Parameters
    ----------
    arm : SoftArm
    dt : float
        Time of a tick [s].
    period_s : float
        Period of its slowest mode [s].
    """
    low, high = arm.robot.pressure_range_pa
    rest = np.full(arm.n_u, rest_pressure(low, high))
    n = max(2, round(2.0 * period_s / dt))
    up, hold = np.linspace(0.0, 1.0, n), np.ones(n)
    share = np.concatenate([up, hold, up[::-1], 0.0 * hold])
    return [rest + share[:, None] * (end - rest) for _, end in targets(arm.robot.chamber_names, low, high)]


WHERE = "soro place-sensors"
# Eigenvalues of a correlation below this are 0: the filter has no disturbance in that direction.
_RANK = 1e-9


@dataclass(frozen=True)
class Placement:
    """Sensors that are chosen, and what they were chosen from.

    Attributes
    ----------
    arm : SoftArm
        Model.
    rest : ndarray (n_q,)
        Coordinates at the start of the motion.
    farthest : ndarray (n_q,)
        Coordinates of the start of a window whose tip is farthest from there.
    candidates : tuple of SensorCandidate
    information : Information
    chosen : tuple of int
        Numbers of the chosen candidates, in the order of choice.
    best : tuple of int or None
        The best set of all, where the sets are few enough to compare.
    noise : SensorNoise
    window_s : float
        Length of a window [s].
    """

    arm: SoftArm
    rest: Array
    farthest: Array
    candidates: tuple[SensorCandidate, ...]
    information: Information
    chosen: tuple[int, ...]
    best: tuple[int, ...] | None
    noise: SensorNoise
    window_s: float


def place_sensors(
    scene: Scene,
    kinds: tuple[str, ...],
    count: int,
    places: int,
    noise: dict[str, float] | None = None,
    pieces: int = 0,
    seconds: float = 0.0,
    show: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> Placement:
    """Choose sensors for a motion.

    Parameters
    ----------
    scene : Scene
        Robot, noise and rates of the sensors, and the loop whose motion is taken.
    kinds : tuple of str
        Kinds of sensors, of `soro_lab.analysis.sensors.KINDS`.
    count : int
        Number of sensors.
    places : int
        Places on each link, its end the last of them.
    noise : dict of str to float, optional
        Deviations in place of those of the scene, keys of `SensorNoise`.
    pieces : int
        Pieces into which each link is split; 0 as the scene has it.
    seconds : float
        Duration of the motion of the scene's loop [s]; 0 for a motion through the range of the pressures.
    show : callable
        Takes what is being done, how much of it is done, and of how much.

    Raises
    ------
    ConfigError
        If an argument is not allowed.
    ModelError
        If the arm has no derivatives, or the motion fails.
    """
    robot = scene.loaded_robot
    require_chambers(robot, WHERE)
    if not 1 <= count <= len(kinds) * places * len(robot.links):
        most = len(kinds) * places * len(robot.links)
        raise ConfigError(WHERE, "--count", count, f"1 to {most}, the number of candidates")
    model = with_changes(scene.discretisation, links=pieces) if pieces else scene.discretisation
    dt = 1.0 / scene.rate_hz
    estimator = Estimator(robot, scene.estimator, dt, model)
    arm = discretised(robot.replace(tip_mass=robot.tip_mass + scene.twin.payload_kg), model)
    used = parse(noise_of(scene.twin, estimator.config) | (noise or {}), SensorNoise, f"{WHERE} --noise")
    candidates = tuple(
        SensorCandidate(kind, place)
        for kind in kinds_of(kinds, used, scene.twin)
        for place in _places([link.length for link in robot.links], places)
    )
    show("motion", 0, 1)
    period = slowest_period(arm)
    runs = [drive(scene, model, seconds).pressure_pa] if seconds else excursions(arm, dt, period)
    ticks = max(1, round(period / dt))
    cut = windows(arm, runs, dt, ticks, lambda done, of: show("windows", done, of))
    root = _root(estimator.filter.settings.initial, 3 * arm.n_q)
    scaled = np.empty((len(cut), len(candidates), root.shape[1], root.shape[1]))
    for k, window in enumerate(cut):
        show("sensors", k, len(cut))
        for c, candidate in enumerate(candidates):
            scaled[k, c] = root.T @ gramian(arm, window, candidate, dt) @ root
    starts = [window.states[0].q for window in cut]
    tips = np.array([np.hstack([tip_jacobian(arm, q), np.zeros((3, 2 * arm.n_q))]) for q in starts])
    information = Information(root, scaled, tips)
    ends = np.array([arm.pose(q, arm.length)[:3, 3] for q in starts])
    far = int(np.argmax(np.linalg.norm(ends - ends[0], axis=1)))
    show("choice", 0, 1)
    chosen = tuple(greedy(information, count))
    return Placement(
        arm,
        starts[0],
        starts[far],
        candidates,
        information,
        chosen,
        best(information, count),
        used,
        ticks * dt,
    )


def _root(initial: Array, n: int) -> Array:
    """Root (n, r) of the first part of the filter's initial covariance, of rank r: q, qd, the disturbance."""
    covariance = np.zeros((n, n))
    part = initial[:n, :n]
    covariance[: len(part), : len(part)] = part
    unit = np.sqrt(np.diag(covariance))
    some = np.where(unit > 0.0, unit, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(some, some))
    known = values > _RANK
    return np.asarray(unit[:, None] * vectors[:, known] * np.sqrt(values[known]))


def _places(lengths: list[float], places: int) -> list[float]:
    """Places [m] along the arm, evenly on each link, its end the last of them."""
    ends = np.cumsum([0.0, *lengths])
    return [
        float(min(end - length + length * k / places, ends[-1]))
        for end, length in zip(ends[1:], lengths, strict=True)
        for k in range(1, places + 1)
    ]
