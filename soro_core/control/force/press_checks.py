"""What is refused before an arm presses: forces that its pressures cannot make, or its friction hides."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.control.force.tip_stiffness import StiffnessAtTip
from soro_core.control.motions.pressure_feasibility import PressureSupply
from soro_core.errors import ConfigError

# Steps to the length at which no chamber of a link needs less than its range has.
_LONGER_STEPS = 3
# Largest force along an axis [N]; a square of it is finite.
LARGEST_N = 1e3


def check_force(supply: PressureSupply, stiffness: StiffnessAtTip, q: Array, push_n: Array) -> None:
    """Refuse a force that no pressures within their range can make.

    All chambers of a link may get more pressure: it becomes longer then, and presses as before, but for what
    the longer link needs itself. So the range must hold the pressures at that length.

    Parameters
    ----------
    supply : PressureSupply
        What the law asks of the chambers, and their range.
    stiffness : StiffnessAtTip
    q : ndarray (n_q,)
        Where the arm begins to press.
    push_n : ndarray (3,)
        Force of the arm at its tip [N].

    Raises
    ------
    ConfigError
        With the chamber and the pressure that it would need.
    """
    direction, still, maker = push_n / np.linalg.norm(push_n), np.zeros_like(q), supply.setpoints
    for _ in range(_LONGER_STEPS):
        push = stiffness.slope(q).T @ (stiffness.nonuniformity(q, direction) * push_n)
        force = supply.force(q, still, still) + push
        need = maker.allocate(supply.actuation(q), force, maker.preferred_pa, wide=True).pressure_pa
        more = [max(float(np.max((maker.minimum_pa - need)[one])), 0.0) for one in stiffness.chambers]
        for of_link, common in zip(stiffness.chambers, more, strict=True):
            need[of_link] += common
        if not (need <= maker.maximum_pa).all():  # what is not finite is not less
            break
        q = q + stiffness.strain_by_common_pressure(q) @ more
    for of_link in stiffness.chambers:
        low, high, of = maker.minimum_pa[of_link], maker.maximum_pa[of_link], need[of_link]
        worst = int(np.argmax(of - high))
        if not of[worst] <= high[worst]:
            name = supply.arm.robot.chamber_names[of_link.start + worst]
            allowed = f"what {1e-3 * low[worst]:g} to {1e-3 * high[worst]:g} kPa make"
            allowed = f"{allowed}; {name} would need {1e-3 * of[worst]:.0f} kPa"
            got = f"{1e3 * np.linalg.norm(push_n):g} mN"
            raise ConfigError("press", "force", got, allowed)


def check_cap(stiffness: StiffnessAtTip, cap_n: float, play_pa: float) -> None:
    """Refuse a cap below the force that the friction of the arm hides: play of its regulators, hysteresis.

    Parameters
    ----------
    stiffness : StiffnessAtTip
    cap_n : float
        The cap [N]; 0 for none.
    play_pa : float
        Play of set point and pressure, its width [Pa].

    Raises
    ------
    ConfigError
        With the least cap.
    """
    if cap_n and cap_n < (least := stiffness.friction(play_pa)):
        allowed = f"{1e3 * least:.1f} mN or more, the friction of the arm, or 0 for no cap"
        raise ConfigError("controller", "force.cap_n", f"{1e3 * cap_n:.1f} mN", allowed)
