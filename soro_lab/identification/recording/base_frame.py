"""Poses and positions in the frame of a body on the base."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from soro_core.arrays import Array
from soro_lab.identification.recording.streams import Marker, Plate, Stream

Kind = TypeVar("Kind", bound=Stream)


def in_frame_of(base: Plate, stream: Kind, moves: bool, turns: bool) -> Kind:
    """Return plates and markers in the frame of the base; other streams, and the base, as they are.

    Parameters
    ----------
    base : Plate
        Poses of a body on the base.
    stream : Stream
        Any stream of the recording.
    moves : bool
        Whether each sample of the base counts, or its median, which has less noise.
    turns : bool
        Whether the rotation of the base counts, or its position alone.
    """
    if stream.name == base.name or not isinstance(stream, Plate | Marker):
        return stream
    position, turn = _pose(base, stream.t, moves)
    back = turn.inv() if turns else Rotation.identity()
    seen: Kind = replace(stream, position=back.apply(stream.position - position))
    if isinstance(seen, Plate):
        seen = replace(seen, quaternion=(back * Rotation.from_quat(seen.quaternion)).as_quat())
    return seen


def mean_quaternion(quaternion: Array) -> Array:
    """Return the mean (4,) of quaternions (n, 4) that lie near each other; q and -q are one rotation."""
    mean = aligned(quaternion).mean(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def aligned(quaternion: Array) -> Array:
    """Return quaternions with the signs that lie nearest to the first one."""
    signs = np.where(quaternion @ quaternion[0] < 0.0, -1.0, 1.0)
    return np.asarray(quaternion * signs[:, None])


def _pose(base: Plate, t: Array, moves: bool) -> tuple[Array, Rotation]:
    if not moves:
        return np.median(base.position, axis=0), Rotation.from_quat(mean_quaternion(base.quaternion))
    position = np.column_stack([np.interp(t, base.t, column) for column in base.position.T])
    turn = np.column_stack([np.interp(t, base.t, column) for column in aligned(base.quaternion).T])
    return position, Rotation.from_quat(turn)
