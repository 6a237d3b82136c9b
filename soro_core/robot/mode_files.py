"""Mode shapes of the basis `pod` from array files, read into the description before it is checked."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from soro_core.csv_rows import read_matrix
from soro_core.errors import ConfigError
from soro_core.robot.bases import BASES
from soro_core.robot.strain import samples_fault

_ENDINGS = (".npy", ".npz", ".csv")


def with_samples(data: Mapping[str, Any], folder: Path, where: str) -> dict[str, Any]:
    """Return a copy of a robot's dictionary in which each `file` of modes has its `samples` beside it.

    What is malformed elsewhere is left as it is: the check of the whole dictionary names it.

    Parameters
    ----------
    data : mapping
        Keys of a robot file; not changed.
    folder : Path
        Folder to which the files are relative.
    where : str
        Robot file, for errors.

    Raises
    ------
    ConfigError
        If a file is missing, or does not hold one real, finite array of shape (n_samples, n_modes).
    """
    links = data.get("links")
    if not isinstance(links, list | tuple):
        return dict(data)
    return {**data, "links": [_link(link, folder, where, f"links[{i}]") for i, link in enumerate(links)]}


def _link(link: Any, folder: Path, where: str, key: str) -> Any:
    strains = link.get("strains") if isinstance(link, Mapping) else None
    if not isinstance(strains, Mapping):
        return link
    read = {
        name: _field(field, folder, where, f"{key}.strains.{name}.file") for name, field in strains.items()
    }
    return {**link, "strains": read}


def _field(field: Any, folder: Path, where: str, key: str) -> Any:
    if not isinstance(field, Mapping) or field.get("samples") is not None:
        return field
    basis = field.get("basis")
    if not isinstance(basis, str) or basis not in BASES or "file" not in BASES[basis].keys:
        return field
    name, modes = field.get("file"), field.get("modes")
    if not isinstance(name, str) or not name:
        return field
    path = folder / name
    if path.suffix not in _ENDINGS:
        raise ConfigError(where, key, name, f"a path ending in {', '.join(_ENDINGS)}")
    if not path.is_file():
        raise ConfigError(where, key, f"{name}: no such file", f"an existing file, relative to {folder}")
    try:
        array = _array(path)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ConfigError(where, key, f"{name}: {error}", "a file with one array of numbers") from None
    if array.dtype.kind not in "fiu":
        raise ConfigError(where, key, f"{name}: values of type {array.dtype}", "real numbers")
    fault = samples_fault(array, modes if isinstance(modes, int) and modes > 0 else None)
    if fault is not None:
        wrong = np.argwhere(~np.isfinite(array))
        found = f"{array[tuple(wrong[0])]} in row {wrong[0][0]}" if len(wrong) else f"shape {array.shape}"
        raise ConfigError(where, key, f"{name}: {found}", fault)
    return {**field, "samples": array.astype(np.float64).tolist()}


def _array(path: Path) -> np.ndarray[Any, Any]:
    if path.suffix == ".csv":
        return np.array(read_matrix(path))
    content = np.load(path, allow_pickle=False)
    if isinstance(content, np.ndarray):
        return content
    with content:
        if len(content.files) != 1:
            raise ValueError(f"{len(content.files)} arrays")
        return np.asarray(content[content.files[0]])
