"""Factors of sparse matrices whose pattern is symmetric."""

from __future__ import annotations

from typing import Any

from scipy.sparse.linalg import splu

# Entries above this share of their column may stay pivots of the diagonal.
PIVOT = 1e-3


def factorised(matrix: Any) -> Any:
    """Return the LU factors of a sparse matrix whose pattern is symmetric, or None where it is singular."""
    try:
        return splu(
            matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=PIVOT, options={"SymmetricMode": True}
        )
    except RuntimeError:
        return None
