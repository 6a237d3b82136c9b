"""A recording of an arm whose numbers are known: levels of each chamber, of pairs and of all, with noise."""

import itertools

import numpy as np
from scipy.spatial.transform import Rotation

from soro_core.model import SoftArm
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.case import Whole
from soro_lab.identification.recording import Place, Plate, Recording, Series

# Where the tracker stands, and how the plate sits on the tip: far from all that a fit begins with.
TRACKER = Rotation.from_rotvec([0.3, -0.2, 1.1])
TRACKER_AT = np.array([0.4, 0.1, 0.8])
MOUNT = Rotation.from_rotvec([0.05, 0.03, -0.2])
MOUNT_AT = np.array([0.002, -0.001, 0.004])


def levels(n_u: int, highest_pa: float) -> list[np.ndarray]:
    """Set points [Pa]: each chamber at two levels up and down, pairs, all."""
    found = []
    for c in range(n_u):
        found += [share * highest_pa * np.eye(n_u)[c] for share in (0.5, 1.0, 0.5, 0.0)]
    for pair in itertools.combinations(range(n_u), 2):
        found.append(0.8 * highest_pa * np.eye(n_u)[list(pair)].sum(axis=0))
    return [*found, highest_pa * np.ones(n_u), np.zeros(n_u)]


def record(robot: Robot, highest_pa: float = 50e3, hold_s: float = 1.2, seed: int = 1) -> Recording:
    """Return what a tracker at 100 Hz and pressure sensors at 200 Hz record of the arm."""
    draw = np.random.default_rng(seed)
    points = [np.zeros(robot.n_u), *levels(robot.n_u, highest_pa)]
    t = np.arange(0.0, hold_s * len(points), 0.005)
    wanted = np.array(points)[np.minimum((t / hold_s).astype(int), len(points) - 1)]
    p = np.zeros_like(wanted)
    for k in range(1, len(t)):  # regulators with a lag of 52 ms
        p[k] = p[k - 1] + 0.005 / 0.052 * (wanted[k - 1] - p[k - 1])
    seen = np.arange(0.0, t[-1], 0.01)
    empty = Plate(
        "tip",
        seen,
        Place(len(robot.links) - 1),
        np.zeros((len(seen), 3)),
        np.tile([0, 0, 0, 1.0], (len(seen), 1)),
    )
    exact = Recording("made", robot.chamber_names, Series("pressure", t, p), plates=(empty,))
    arm = SoftArm(robot)
    whole = Whole(exact, dt=0.0025, rate_hz=1e3)
    q = whole.coordinates(whole.simulated(arm, {}), {})[0]
    poses = arm.poses(q, arm.length)
    rotation = Rotation.from_matrix(poses[:, :3, :3])
    position = TRACKER.apply(poses[:, :3, 3] + rotation.apply(MOUNT_AT)) + TRACKER_AT
    noise = Rotation.from_rotvec(draw.normal(0.0, 5e-3, (len(seen), 3)))
    plate = Plate(
        "tip",
        seen,
        empty.place,
        position + draw.normal(0.0, 3e-4, position.shape),
        (TRACKER * rotation * MOUNT * noise).as_quat(),
    )
    read = np.round((p + draw.normal(0.0, 100.0, p.shape)) / 100.0) * 100.0
    return Recording("made", robot.chamber_names, Series("pressure", t, read), plates=(plate,))
