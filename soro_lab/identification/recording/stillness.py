"""When pressures and shape of a recording stand still, in blocks, and whether it moves at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import ConfigError
from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.streams import (
    Attitude,
    Bend,
    Curvature,
    Marker,
    Plate,
    Series,
    Stream,
)

# Noise counts with three deviations. Third differences leave 3 % of an oscillation at a twelfth of the rate.
_SIGMAS, _ORDER = 3.0, 3
# Parts of a range between which its size is measured: single outliers do not count.
_INNER = (0.5, 99.5)


@dataclass(frozen=True)
class StillLimits:
    """Below which change a stream stands still, within a block and over one second; noise comes on top.

    Attributes
    ----------
    pressure_pa : float
        Pressures [Pa].
    position_m : float
        Positions [m].
    curvature_per_m : float
        Curvatures [1/m].
    bend_rad : float
        Bending angles, and rotations of IMUs [rad].
    block_s : float
        Length of a block [s].
    least_s : float
        Shortest rest [s].
    """

    pressure_pa: float
    position_m: float
    curvature_per_m: float
    bend_rad: float
    block_s: float = 0.25
    least_s: float = 0.75

    def of(self, stream: Stream) -> float:
        """Return the limit of a stream in its unit."""
        if isinstance(stream, Series):
            return self.pressure_pa
        if isinstance(stream, Curvature):
            return self.curvature_per_m
        return self.bend_rad if isinstance(stream, Bend | Attitude) else self.position_m


@dataclass(frozen=True)
class Blocks:
    """Blocks of a recording in which streams stand still.

    Attributes
    ----------
    edges : array of shape (n + 1,)
        Times [s] at which blocks begin, and the end of the last.
    pressure_still, shape_still : arrays of shape (n,) of bool
        Whether all pressures, or all shapes that have samples there, stand still.
    pressure_known, shape_known : arrays of shape (n,) of bool
        Whether there are pressures, or samples of any shape; without samples nothing is said of a block.
    """

    edges: Array
    pressure_still: Flags
    shape_still: Flags
    pressure_known: Flags
    shape_known: Flags

    @property
    def rest(self) -> Flags:
        """Blocks in which everything stands still."""
        known = self.pressure_known & self.shape_known
        return known & self.pressure_still & self.shape_still


def still_limits(
    recordings: Sequence[Recording], pressure: float = 0.02, shape: float = 0.005
) -> StillLimits:
    """Return limits that are parts of the ranges moved in some recordings.

    Give all recordings of an arm: of one without motion the range is its noise.

    Parameters
    ----------
    recordings : sequence of Recording
    pressure, shape : float
        Limit of pressures, part of their range; of the shape, part of the largest range of its kind.
    """

    def largest(kind: type[Stream] | tuple[type[Stream], ...], part: float) -> float:
        streams = [s for r in recordings for s in (r.pressure, *r.shapes)]
        found = [s for s in streams if isinstance(s, kind) and s.t.size]
        ranges = [np.ptp(np.percentile(stream.motion(), _INNER, axis=0), axis=0).max() for stream in found]
        return part * float(max(ranges, default=0.0))

    return StillLimits(
        pressure_pa=largest(Series, pressure),
        position_m=largest((Plate, Marker), shape),
        curvature_per_m=largest(Curvature, shape),
        bend_rad=largest((Bend, Attitude), shape),
    )


def blocks(recording: Recording, limits: StillLimits) -> Blocks:
    """Return in which blocks of a recording its streams stand still."""
    start, end = recording.span
    number = max(1, round((end - start) / limits.block_s))
    edges = np.linspace(start, end, number + 1)
    still, known = _still(recording.pressure, edges, limits)
    shape_still, shape_known = np.ones(number, bool), np.zeros(number, bool)
    for stream in recording.shapes:
        one_still, one_known = _still(stream, edges, limits)
        shape_still &= one_still | ~one_known
        shape_known |= one_known
    return Blocks(edges, still, shape_still, known, shape_known)


def noise(stream: Stream) -> Array:
    """Return the deviation (m,) of the noise of a stream's motion, over most of its time.

    From third differences of the samples, which are small for a motion that is slow against the rate; of
    short parts the median counts, so that steps do not.
    """
    differences = np.diff(stream.motion(), _ORDER, axis=0)
    if not len(differences):
        return np.zeros(stream.motion().shape[1])
    parts = np.array_split(differences, max(1, len(differences) // 10))
    return np.asarray(np.median([np.sqrt((part**2).mean(axis=0)) for part in parts], axis=0) / np.sqrt(20.0))


def stretches(mask: Flags) -> list[tuple[int, int]]:
    """Return the first block and the block after the last of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]


def _still(stream: Stream, edges: Array, limits: StillLimits) -> tuple[Flags, Flags]:
    """Return in which blocks a stream stands still, and in which it has samples."""
    number = len(edges) - 1
    index = np.searchsorted(edges, stream.t, side="right") - 1
    index[stream.t == edges[-1]] = number - 1
    table = stream.motion()
    mean, spread = (np.full((number, table.shape[1]), np.nan) for _ in range(2))
    count = np.bincount(index[(index >= 0) & (index < number)], minlength=number)
    for filled in np.flatnonzero(count):
        inside = table[index == filled]
        mean[filled], spread[filled] = inside.mean(axis=0), inside.std(axis=0)
    known = count > 0
    if not known.any():
        return np.zeros(number, bool), known
    each = _SIGMAS * noise(stream)
    still = known & (np.nan_to_num(spread) <= limits.of(stream) + each).all(axis=1)
    band = limits.of(stream) + each * np.sqrt(2.0 / np.median(count[known]))

    def apart(step: int) -> Flags:
        moved: Flags = (np.abs(np.nan_to_num(mean[step:] - mean[:-step])) > band).any(axis=1)
        return moved

    # A step within a block moves its mean: the blocks beside it are still.
    jumped = np.flatnonzero(apart(1) & still[1:] & still[:-1])
    still[jumped] = still[jumped + 1] = False
    # A slow motion that no pair of blocks shows is seen over a second without a jump.
    lag = max(2, round(1.0 / (edges[1] - edges[0])))
    drifted = apart(lag)
    for begin, end in stretches(still):
        for block in range(begin, end - lag):
            if drifted[block]:
                still[block + lag // 2] = False
    return still, known


# A range below so many deviations of the noise is noise: that of 10 000 samples spans 8.
_NOISE = 10.0


def moves(stream: Stream) -> bool:
    """Return whether a stream moves by more than its noise."""
    table = stream.motion()
    return len(table) > 3 and bool((np.ptp(table, axis=0) > _NOISE * noise(stream)).any())


def check_motion(recordings: Sequence[Recording]) -> None:
    """Refuse recordings in none of which the arm moves; one at rest among others is evidence of the rest.

    Raises
    ------
    ConfigError
        That names them.
    """
    if not any(moves(stream) for recording in recordings for stream in recording.shapes):
        names = ", ".join(recording.name for recording in recordings) or "no recording"
        raise ConfigError(names, "", "no motion", "one or more recordings in which the arm moves")
