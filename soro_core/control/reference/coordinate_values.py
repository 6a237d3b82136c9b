"""Configured values of strains, spread over the coordinates of a robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.robot.coordinates import StrainFields


def per_coordinate(fields: StrainFields, values: Sequence[float], key: str) -> tuple[Array, bool]:
    """Spread values over the coordinates.

    Allowed are one value for each strain of a link (repeated for every link and for the coefficients of the
    strain), one for each coordinate, or one for each coordinate of a link. If two of these fit, the first
    applies.

    Parameters
    ----------
    fields : StrainFields
        Strains of the robot.
    values : sequence of float
        Configured values.
    key : str
        Key of the controller file that errors name.

    Returns
    -------
    values : ndarray (n_q,)
    of_strains : bool
        Whether there was one value for each strain of a link.

    Raises
    ------
    ConfigError
        If the number of values fits none of these.
    """
    n, links, given = len(fields.index), fields.links[-1] + 1, len(values)
    array = np.array(values, dtype=np.float64)
    if given * links == len(fields.strains):
        return np.tile(array, links)[fields.index], True
    if given == n:
        return array, False
    if given * links == n:
        return np.tile(array, links), False
    counts = sorted({len(fields.strains) // links, n // links, n})
    allowed = f"{' or '.join(map(str, counts))} values: one a strain of a link, or one a coordinate"
    raise ConfigError("controller", key, list(values), allowed)


def gain_matrix(fields: StrainFields, values: Sequence[float], key: str) -> Array:
    """Return K_p or K_d (n_q, n_q); parameters as in `per_coordinate`.

    Values of strains are multiplied by W of docs/model.md (4); values of coordinates are the diagonal.

    Raises
    ------
    ConfigError
        If the number of values does not fit.
    """
    spread, of_strains = per_coordinate(fields, values, key)
    return spread[:, None] * fields.weight if of_strains else np.diag(spread)
