"""The verdict on modes: what two of them gain over constant strain, and the reason where it is below 3."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_rod import Z, made_data, poses_of

from soro_design.parts.sweeps import Backbone
from soro_design.robot_of_part.modes import kept, modes
from soro_design.robot_of_part.written import kept_verdict, link_verdict

DATA = made_data(n=1)
PLACE = 0.5 * (Z[1:] + Z[:-1]) / Z[-1]


def state(shape):
    """A state whose curvature (1/m) and elongation (in %) have a shape along the rod."""
    strains = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (16, 1))
    strains[:, 1] = shape
    strains[:, 5] += 0.01 * shape
    return Backbone("made", 1.0, np.zeros(3), np.zeros(3), False, poses_of(strains))


def compared(fitted, held_out):
    fitted, held_out = ([state(shape) for shape in shapes] for shapes in (fitted, held_out))
    found = modes(DATA, fitted, 3)
    return [
        tuple(kept(DATA, states, found if n else None, n) for states in (fitted, held_out)) for n in range(4)
    ]


def bump(at):
    return 5.0 * np.exp(-(((PLACE - at) / 0.08) ** 2))


UNIFORM, RISING = np.full(16, 5.0), 5.0 * PLACE
SLIGHT = UNIFORM + 0.02 * np.sin(12.0 * PLACE)


@pytest.mark.parametrize(
    ("fitted", "held_out", "reason"),
    [
        ([UNIFORM, RISING, RISING - UNIFORM], [0.5 * UNIFORM + RISING], ""),
        ([UNIFORM, 0.5 * UNIFORM], [SLIGHT], "uniform"),
        ([UNIFORM, RISING], [bump(0.3)], "other shapes"),
        ([bump(x) for x in np.linspace(0.1, 0.9, 6)], [bump(0.2), bump(0.6)], "changes with the load"),
    ],
    ids=["gain", "uniform", "held out", "too many shapes"],
)
def test_two_modes_gain_three_times_or_the_line_says_why(fitted, held_out, reason, figure):
    line = kept_verdict(compared(fitted, held_out))
    figure(line)
    assert "(3 asked)" in line
    assert ("because" in line) == bool(reason)
    assert reason in line


@pytest.mark.parametrize(
    ("modal", "kept_share", "reason"),
    [(0.002, 1e-4, ""), (0.009, 1e-4, "one stiffness along its length"), (0.009, 8e-3, "by as much")],
)
def test_the_link_gains_or_the_line_says_why(modal, kept_share, reason):
    constant, with_modes = ([SimpleNamespace(share=share)] for share in (0.01, modal))
    line = link_verdict(constant, with_modes, 2, SimpleNamespace(tip_mean=kept_share))
    assert "with 2 modes" in line
    assert f"{0.01 / modal:.3g} times less" in line
    assert ("because" in line) == bool(reason)
    assert reason in line
