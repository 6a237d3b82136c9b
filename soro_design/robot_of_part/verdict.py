"""What modes of the strain gain over constant strain, and where it is little, why; docs/parts.md (9)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soro_design.robot_of_part.joint import TipError
from soro_design.robot_of_part.modes import Kept

# How many times less two modes shall miss than constant strain.
ASKED = 3.0
# Below this share, missed by constant strain, the strain of a part is uniform.
UNIFORM = 0.02


def kept_verdict(compared: Sequence[tuple[Kept, Kept]]) -> str:
    """Return the line on what two modes keep of the held-out strains, with a reason where that is too little.

    Parameters
    ----------
    compared : sequence of tuple of Kept
        Of constant strain, one mode, two modes and three: of the fitted and of the held-out states.
    """
    constant, two = compared[0][1], compared[2][1]
    gain = _gain(constant.strain, two.strain)
    line = (
        f"Two modes miss {100.0 * two.strain:.2g} % of the held-out strains, constant strain"
        f" {100.0 * constant.strain:.2g} %: {_times(gain)} ({ASKED:g} asked)"
    )
    return f"{line}." if gain >= ASKED else f"{line}, because {_reason(compared)}."


def link_verdict(constant: Sequence[TipError], modal: Sequence[TipError], n: int, two: Kept) -> str:
    """Return the line on the tip of the link with modes against that of constant strain.

    Parameters
    ----------
    constant, modal : sequence of TipError
        Of the held-out states: of the link of constant strain, of that with modes.
    n : int
        Modes of each strain.
    two : Kept
        What these modes keep of the same states by projection.
    """
    means = [float(np.mean([error.share for error in own])) for own in (constant, modal)]
    gain = _gain(*means)
    line = (
        f"Held-out tip of the link: mean {100.0 * means[1]:.2g} % with {n} {'mode' if n == 1 else 'modes'},"
        f" {100.0 * means[0]:.2g} % with constant strain: {_times(gain)} ({ASKED:g} asked)"
    )
    if gain >= ASKED:
        return f"{line}."
    if _gain(means[0], two.tip_mean) < ASKED:
        return f"{line}, because the tip of the strains that the modes keep is off by as much."
    return (
        f"{line}, because the link has one stiffness along its length: the strains that the modes keep have"
        f" their tip within {100.0 * two.tip_mean:.2g} %."
    )


def _reason(compared: Sequence[tuple[Kept, Kept]]) -> str:
    constant, fitted = compared[0][1], _gain(compared[0][0].strain, compared[2][0].strain)
    if constant.strain < UNIFORM:
        return f"the strain is uniform to {100.0 * UNIFORM:g} %"
    if fitted >= ASKED:
        return (
            f"held-out states have other shapes of strain than the fitted ones, where it is {_times(fitted)}"
        )
    three = _gain(constant.strain, compared[3][1].strain)
    return f"the shape of the strain changes with the load; with three modes it is {_times(three)}"


def _gain(constant: float, modal: float) -> float:
    return constant / max(modal, 1e-12)


def _times(gain: float) -> str:
    return f"{gain:.3g} times less" if gain >= 1.0 else f"{1.0 / gain:.3g} times more"
