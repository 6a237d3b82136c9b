"""What is known of the arm, or was before a force from outside, read for links that bend non-uniformly.

Where the arm has been, a softer one is as well explained by areas with another slope and by a load, and a
stiffer one by a load below zero; how it gives way to a push differs by up to 30 %, and a load bends a link
non-uniformly. The file's areas are those of the drawing, its modulus is not: a change of that shows in the
elongation by the mean pressure, which a load hardly changes, and the load in the bend. So what was learned is
read as a part of the elastic force, a load, and little else.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core.adaptation.config import mass_prior
from soro_core.adaptation.force import LearnedForce
from soro_core.adaptation.learned import Learned, first_damping
from soro_core.arrays import Array

# A force is seen up to two of these times after it has begun to teach [s].
_PAST_S = 0.2
# Prior deviation of a modulus, as a part of the file's; and that of the load from the learned one, as a part
# of the largest that is expected.
_MODULUS, _LOAD = 0.3, 0.2
# Chi-square (3 components, 99 %) of the rest from which on it is another arm: what was learned stands.
_ANOTHER = 11.3


class Before(NamedTuple):
    """What was known a while ago.

    Attributes
    ----------
    age_s : float
        [s].
    theta : ndarray
        Load [kg], W and damping, as in `Learned.theta`.
    q : ndarray (n_q,)
        Coordinates.
    """

    age_s: float
    theta: Array
    q: Array


class Reading(NamedTuple):
    """What is known, read for an arm whose links bend non-uniformly.

    Attributes
    ----------
    load_kg : float
        Load [kg].
    modulus : float
        Elastic force of the arm as a part of that of its file.
    beside : ndarray (n_q,) or None
        What a modulus and a load do not explain, a constant force in units of the learned one; None where
        they explain nothing, and what is learned stands.
    """

    load_kg: float
    modulus: float = 1.0
    beside: Array | None = None

    def theta_of(self, theta: Array) -> Array:
        """Return load, W and damping as read.

        Parameters
        ----------
        theta : ndarray
            What is learned now, as `Learned.theta`.
        """
        found = theta.copy()
        found[0] = self.load_kg
        if self.beside is not None:
            n = self.beside.size
            found[1 : first_damping(n)] = 0.0
            found[1 : first_damping(n) : n + 1] = self.beside
        return found


def kept(past: tuple[Before, ...], now: Before, dt: float) -> tuple[Before, ...]:
    """Return what was known up to two times `_PAST_S` ago, oldest first, with what is known now.

    Parameters
    ----------
    past : tuple of Before
        The same at the last estimate.
    now : Before
    dt : float
        Time since the last estimate [s].
    """
    older = tuple(one._replace(age_s=one.age_s + dt) for one in past)
    if older and older[-1].age_s < _PAST_S:
        return older
    return (*older[-1:], now)


def read(force: LearnedForce, before: Before, model_std_pa: float) -> Reading:
    """Return what is known, as a modulus and a load where they explain it.

    Parameters
    ----------
    force : LearnedForce
    before : Before
    model_std_pa : float
        Deviation of the model from the arm beside them, as a pressure in each chamber [Pa].
    """
    arm, q, theta = force.arm, before.q, before.theta
    still, unit = np.zeros(arm.n_q), force.scales.force
    elastic, by_mass = arm.elastic_force(q) / unit, arm.tip_mass_force(q, still, still) / unit
    learned = force.force(Learned(theta), q, still, still) / unit - theta[0] * by_mass
    single = model_std_pa * arm.actuation_matrix(q) / unit[:, None]
    columns = np.column_stack([elastic, by_mass])
    prior = np.square([_MODULUS, _LOAD * mass_prior(arm)[0]])
    covariance = (columns * prior) @ columns.T + single @ single.T
    try:
        weighed = np.linalg.solve(covariance, learned)
    except np.linalg.LinAlgError:
        return Reading(float(theta[0]))
    if not learned @ weighed < _ANOTHER:  # what is not finite is not less
        return Reading(float(theta[0]))
    more, load_kg = prior * (columns.T @ weighed)
    beside = learned - columns @ (more, load_kg)
    return Reading(float(theta[0] + load_kg), 1.0 + float(more), beside)
