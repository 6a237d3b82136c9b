"""STL files of triangles: written in binary, read in either form."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError

# Of each triangle its normal, its corners and two bytes.
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD = 80


def write_stl(path: str | Path, points: Array, triangles: Integers, unit_m: float = 1e-3) -> None:
    """Write triangles as a binary STL file.

    Parameters
    ----------
    path : str or Path
        File, which is replaced.
    points : ndarray, (n, 3)
        Corners [m].
    triangles : ndarray of int, (t, 3)
        Corners of each triangle, turned outwards.
    unit_m : float
        Unit of the file [m]; printers take millimetres.

    Raises
    ------
    ModelError
        If the file cannot be written.
    """
    records = np.zeros(len(triangles), dtype=_RECORD)
    corners = points[triangles] / unit_m
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    records["normal"] = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    records["corners"] = corners
    head = b"soro".ljust(_HEAD) + len(triangles).to_bytes(4, "little")
    try:
        Path(path).write_bytes(head + records.tobytes())
    except OSError as error:
        raise ModelError(f"path {path}: {error.strerror}; allowed: one that can be written", "path") from None


def read_stl(path: str | Path, unit_m: float = 1e-3) -> tuple[Array, Integers]:
    """Return corners (n, 3) [m], one at each place, and triangles (t, 3) of an STL file in units of `unit_m`.

    Raises
    ------
    ModelError
        If the file cannot be read, or is no such file.
    """
    try:
        raw = Path(path).read_bytes()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise ModelError(f"path {path}: {why}; allowed: an STL file", "path") from None
    corners = _binary(raw) if len(raw) >= _HEAD + 4 else None
    corners = _ascii(raw) if corners is None else corners
    if corners is None or len(corners) == 0 or not np.isfinite(corners).all():
        raise ModelError(f"path {path}: no triangles of finite corners; allowed: an STL file", "path")
    points, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return points.astype(float) * unit_m, numbers.reshape(-1, 3).astype(np.int64)


def _binary(raw: bytes) -> Array | None:
    """Corners (t, 3, 3), or None where the length is not the one that the head states."""
    count = int.from_bytes(raw[_HEAD : _HEAD + 4], "little")
    if len(raw) != _HEAD + 4 + count * _RECORD.itemsize:
        return None
    return np.asarray(np.frombuffer(raw, dtype=_RECORD, offset=_HEAD + 4)["corners"])


def _ascii(raw: bytes) -> Array | None:
    """Corners (t, 3, 3), or None where there are none."""
    rows = [line.split()[1:] for line in raw.decode("ascii", "replace").splitlines() if "vertex" in line]
    try:
        return np.array(rows, dtype="<f4").reshape(-1, 3, 3)
    except ValueError:
        return None
