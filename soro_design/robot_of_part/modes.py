"""Modes of the strain along a rod from its states: the basis `pod` of a robot file; docs/parts.md (9)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import expm

from soro_core.arrays import Array
from soro_core.rotation import skew
from soro_design.parts.sweeps import Backbone
from soro_design.robot_of_part.snapshots import Snapshots

SAMPLES = 61


@dataclass(frozen=True, eq=False)
class PodModes:
    """Shapes of the strains along a rod, the strongest first, each of mean square 1.

    Attributes
    ----------
    elongation, bending : ndarray, (s - 1, m)
        Between the sections; bending_x and bending_y share theirs.
    """

    elongation: Array
    bending: Array


def modes(data: Snapshots, states: Sequence[Backbone], n: int) -> PodModes:
    """Return `n` modes of each strain: those that leave the least mean square of the strains of the states.

    Parameters
    ----------
    data : Snapshots
        Of the rod.
    states : sequence of Backbone
        Whose strains count.
    n : int
        Number of modes.
    """
    strains = np.array([data.strains(state) for state in states])
    root = np.sqrt(np.diff(data.z) / data.length)
    found = []
    for rows in (strains[:, :, 0], np.concatenate([strains[:, :, 1], strains[:, :, 2]])):
        _, _, shapes = np.linalg.svd(rows * root, full_matrices=False)
        each = (shapes[:n] / root).T
        found.append(each * np.where(each.mean(axis=0) < 0.0, -1.0, 1.0))
    return PodModes(*found)


@dataclass(frozen=True)
class Kept:
    """What a basis keeps of states.

    Attributes
    ----------
    strain : float
        Root mean square of what is missing of the strains, each strain over its own root mean square.
    tip_mean, tip_most : float
        Error of the tip of the kept strains over the length.
    """

    strain: float
    tip_mean: float
    tip_most: float


def kept(data: Snapshots, states: Sequence[Backbone], found: PodModes | None, n: int = 0) -> Kept:
    """Return what modes keep of states by projection.

    Parameters
    ----------
    data : Snapshots
    states : sequence of Backbone
    found : PodModes or None
        None for constant strains.
    n : int
        Number of modes that are used, the first ones.
    """
    dz = np.diff(data.z)
    strains = np.array([data.strains(state) for state in states])
    if found is None:
        shapes = [np.ones((len(dz), 1))] * 3
    else:
        shapes = [each[:, :n] for each in (found.elongation, found.bending, found.bending)]
    left = np.empty_like(strains)
    for k, basis in enumerate(shapes):
        weighted = basis.T * dz
        left[:, :, k] = strains[:, :, k] @ (np.linalg.solve(weighted @ basis, weighted)).T @ basis.T
    groups = (slice(0, 1), slice(1, 3))
    missing = [
        float(np.sqrt((dz @ ((strains - left)[:, :, g] ** 2)).sum() / (dz @ (strains[:, :, g] ** 2)).sum()))
        for g in groups
    ]
    far = [np.linalg.norm(tip(left[i], dz) - tip(strains[i], dz)) / data.length for i in range(len(states))]
    return Kept(float(np.linalg.norm(missing) / np.sqrt(2.0)), float(np.mean(far)), float(np.max(far)))


def tip(strains: Array, dz: Array) -> Array:
    """Return the end (3,) [m] of a rod whose strains (s, 3) are constant on pieces of lengths (s,) [m]."""
    pose = np.eye(4)
    for (elongation, bending_x, bending_y), length in zip(strains, dz, strict=True):
        twist = np.zeros((4, 4))
        twist[:3, :3] = skew(np.array([-bending_y, bending_x, 0.0]))
        twist[2, 3] = 1.0 + elongation
        pose = pose @ expm(length * twist)
    return np.asarray(pose[:3, 3])


def samples_of(data: Snapshots, found: PodModes) -> dict[str, Array]:
    """Return the modes of elongation and bending as a robot file has them: (61, m) at equal distances."""
    middle = 0.5 * (data.z[1:] + data.z[:-1])
    places = np.linspace(data.z[0], data.z[-1], SAMPLES)
    return {
        name: np.stack([np.interp(places, middle, shape) for shape in shapes.T], axis=1)
        for name, shapes in (("elongation", found.elongation), ("bending", found.bending))
    }


def strain_keys(samples: Mapping[str, Array], out: Path | None = None) -> dict[str, dict[str, Any]]:
    """Return the key `strains` of a robot file that has these modes.

    Parameters
    ----------
    samples : mapping of str to ndarray
        Of `samples_of`.
    out : Path, optional
        The robot file, if the samples stand in NAME_elongation.npy and NAME_bending.npy beside it.
    """
    keys = {}
    for strain, name in (("elongation", "elongation"), ("bending_x", "bending"), ("bending_y", "bending")):
        own = {"samples": samples[name].tolist()} if out is None else {"file": mode_file(out, name).name}
        keys[strain] = {"basis": "pod", "modes": samples[name].shape[1], **own}
    return keys


def mode_file(out: Path, name: str) -> Path:
    """Return the file of the modes of elongation or bending beside a robot file."""
    return out.with_name(f"{out.stem}_{name}.npy")
