"""Frames of a measurement: numbers of where the tracker stands and how bodies sit on their sections."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from soro_core.arrays import Array
from soro_core.model import SoftArm
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.case import Case, Whole, clock
from soro_lab.identification.arm.cases.parameters import ArmParameter
from soro_lab.identification.recording.streams import Attitude, Curvature, Marker, Plate, Shape

# Deviations before any data, about what `frame_numbers` finds: of the tracker, of a body whose place is
# stated, and of a marker whose place is not.
_TURN, _PLACE = 0.5, 0.1
_BODY, _MARKER = 0.005, 0.05
_CURVATURE = 1.0
# Deviation of the clock of a run [s] before any data, where pressures were measured and where they are
# stated, and the most.
_CLOCK, _STATED_CLOCK, _MOST_CLOCK = 0.02, 0.1, 0.5


def frame_numbers(arm: SoftArm, cases: Sequence[Case]) -> tuple[ArmParameter, ...]:
    """Return the numbers of all frames, each at its best for the arm as it is described.

    The rotation and place of the tracker come from positions and turns of all bodies (Kabsch), the rotation
    of a body on its section from the mean of what is left.

    Parameters
    ----------
    arm : SoftArm
        As described before the fit; its motions need the right directions, not the right size.
    cases : sequence of Case
    """
    seen = [
        (s, q)
        for case in cases
        for s, q in zip(case.shapes, case.coordinates(case.simulated(arm, {}), {}), strict=True)
    ]
    numbers = [n for shape, q in seen if isinstance(shape, Curvature) for n in _camera(shape)]
    bodies = [(s, arm.poses(q, s.place.along(arm.robot))) for s, q in seen if isinstance(s, Plate | Marker)]
    imus = [(s, arm.poses(q, s.place.along(arm.robot))) for s, q in seen if isinstance(s, Attitude)]
    for name in dict.fromkeys(imu.name for imu, _ in imus):
        numbers += _imu([(imu, poses) for imu, poses in imus if imu.name == name])
    for frame in dict.fromkeys(body.frame for body, _ in bodies):
        numbers += _tracker([(body, poses) for body, poses in bodies if body.frame == frame])
    return tuple({n.name: n for n in numbers}.values())


def calibrated(robot: Robot, shapes: Iterable[Shape], values: Mapping[str, float]) -> Robot:
    """Return the robot with the frames that were found as its calibration: of one tracker, the first.

    Parameters
    ----------
    robot : Robot
    shapes : iterable of Shape
        What was seen.
    values : mapping of str to float
        Numbers of `frame_numbers` by name.
    """
    keys: dict[str, Any] = {}
    bodies: dict[str, dict[str, Any]] = {}
    shapes = list(shapes)
    frame = next((shape.frame for shape in shapes if isinstance(shape, Plate)), "")
    for shape in shapes:
        at = f"frame/{shape.name}"
        if isinstance(shape, Plate) and shape.frame == frame:
            bodies[shape.name] = {
                "at": shape.place.along(robot) / robot.length,
                "offset_m": _vector(values, f"{at}/offset"),
                "quaternion": _quaternion(values, f"{at}/turn"),
            }
        elif isinstance(shape, Curvature):
            keys["frame_rotation_rad"] = values[f"{at}/turn"]
            keys["curvature_offset"] = (values[f"{at}/offset_x"], values[f"{at}/offset_y"])
    if bodies:
        keys["tracker_position"] = _vector(values, f"frame/{frame}/offset")
        keys["tracker_quaternion"] = _quaternion(values, f"frame/{frame}/turn")
        keys["bodies"] = list(bodies.values())
    return robot.replace(calibration=keys) if keys else robot


def _vector(values: Mapping[str, float], name: str) -> tuple[float, ...]:
    return tuple(values[f"{name}_{axis}"] for axis in "xyz")


def _quaternion(values: Mapping[str, float], name: str) -> tuple[float, ...]:
    return tuple(float(v) for v in Rotation.from_rotvec(_vector(values, name)).as_quat())


def clock_numbers(cases: Sequence[Case]) -> tuple[ArmParameter, ...]:
    """Return by how much the stamps of the shape of each run are late against those of its pressures."""
    return tuple(
        ArmParameter(
            clock(case.name),
            0.0,
            "s",
            "shift",
            _STATED_CLOCK if case.recording.is_stated else _CLOCK,
            -_MOST_CLOCK,
            _MOST_CLOCK,
        )
        for case in cases
        if isinstance(case, Whole)
    )


def _tracker(bodies: Sequence[tuple[Plate | Marker, Array]]) -> list[ArmParameter]:
    predicted = np.concatenate([poses[:, :3, 3] for _, poses in bodies])
    measured = np.concatenate([body.position for body, _ in bodies])
    middle, shift = predicted.mean(axis=0), measured.mean(axis=0)
    frame = bodies[0][0].frame
    # The tip of an arm that bends in one plane moves on a line, nearly: the axis of its turns tells the rest.
    shown, modelled = _turned(bodies)
    far = np.linalg.norm(shown)
    scale = np.linalg.norm(measured - shift) / far if far > 0.0 else 1.0
    turn, _ = Rotation.align_vectors(
        np.concatenate([measured - shift, scale * shown]),
        np.concatenate([predicted - middle, scale * modelled]),
    )
    numbers = _three(f"{frame}/turn", turn.as_rotvec(), "rad", _TURN)
    numbers += _three(f"{frame}/offset", shift - turn.apply(middle), "m", _PLACE)
    for name in dict.fromkeys(body.name for body, _ in bodies):
        numbers += _body([(b, poses) for b, poses in bodies if b.name == name], turn)
    return numbers


def _turned(bodies: Sequence[tuple[Plate | Marker, Array]]) -> tuple[Array, Array]:
    """Return turns of plates from their mean, (n, 3) [rad], as measured and as predicted."""
    pairs = [(np.zeros((0, 3)), np.zeros((0, 3)))]
    for body, poses in bodies:
        if isinstance(body, Plate) and len(poses):
            both = Rotation.from_quat(body.quaternion), Rotation.from_matrix(poses[:, :3, :3])
            measured, predicted = ((turns * turns.mean().inv()).as_rotvec() for turns in both)
            pairs.append((measured, predicted))
    return np.concatenate([m for m, _ in pairs]), np.concatenate([p for _, p in pairs])


def _body(same: Sequence[tuple[Plate | Marker, Array]], turn: Rotation) -> list[ArmParameter]:
    body = same[0][0]
    if isinstance(body, Marker):
        return [] if body.offset else _three(f"{body.name}/offset", np.zeros(3), "m", _MARKER)
    sections = Rotation.from_matrix(np.concatenate([poses[:, :3, :3] for _, poses in same]))
    shown = Rotation.from_quat(np.concatenate([b.quaternion for b, _ in same if isinstance(b, Plate)]))
    mount = (sections.inv() * turn.inv() * shown).mean()
    return [
        *_three(f"{body.name}/turn", mount.as_rotvec(), "rad", _TURN),
        *_three(f"{body.name}/offset", np.zeros(3), "m", _BODY),
    ]


def _imu(same: Sequence[tuple[Attitude, Array]]) -> list[ArmParameter]:
    """Return the turn of the world of an IMU, from the axes about which it turns, and that of its mount."""
    name = same[0][0].name
    sections = Rotation.from_matrix(np.concatenate([poses[:, :3, :3] for _, poses in same]))
    shown = Rotation.from_quat(np.concatenate([imu.quaternion for imu, _ in same]))
    turned = [(r * r[0].inv()).as_rotvec() for r in (shown, sections)]
    world, _ = Rotation.align_vectors(*turned)
    mount = (sections.inv() * world.inv() * shown).mean()
    return [
        *_three(f"{name}/world", world.as_rotvec(), "rad", _TURN),
        *_three(f"{name}/turn", mount.as_rotvec(), "rad", _TURN),
    ]


def _camera(shape: Shape) -> list[ArmParameter]:
    at = f"frame/{shape.name}"
    return [
        ArmParameter(f"{at}/turn", 0.0, "rad", "shift", _TURN, -np.pi, np.pi),
        *(ArmParameter(f"{at}/offset_{x}", 0.0, "1/m", "shift", _CURVATURE, -1e3, 1e3) for x in "xy"),
    ]


def _three(name: str, values: Array, unit: str, doubt: float) -> list[ArmParameter]:
    return [
        ArmParameter(f"frame/{name}_{axis}", float(v), unit, "shift", doubt, -1e3, 1e3)
        for axis, v in zip("xyz", values, strict=True)
    ]
