"""Adapted parameters: their place in the model, bounds and regressor.

The force is linear in them, docs/model.md (37). Each adapted parameter has a column of the regressor; all
others keep the values of the robot file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from soro_core.adaptation.config import follow_rate, mass_prior
from soro_core.adaptation.scales import scales_of
from soro_core.arrays import Array
from soro_core.config import parse
from soro_core.control.passivity.adaptation_config import Adaptation, CompleteAdaptation
from soro_core.control.passivity.projection import Pair, Polytope
from soro_core.errors import ConfigError
from soro_core.robot.coordinates import STRETCHES, StrainFields, strain_fields

if TYPE_CHECKING:  # a scene reads a law's keys without its model
    from soro_core.model import SoftArm


_ELASTIC = ("a1", "a2", "a4", "a5")


@dataclass(frozen=True)
class Column:
    """One adapted parameter: its configured group, and its column in the regressor of that group.

    For damping, the column is the number of the strain field. The parameter is a damping rho that is uniform
    along the link, with the force rho W v, W of docs/model.md (4): one parameter for all coefficients of the
    strain.
    """

    name: str
    group: str
    index: int
    nominal: float


class ParameterSet:
    """Adapted parameters of one robot; immutable.

    Parameters
    ----------
    arm : SoftArm
        Model.
    config : Adaptation
        Groups of parameters, gains and bounds; what is not stated comes from the model.
    where : str
        File that errors name.
    pieces : int
        Number of pieces into which each link is discretised.

    Attributes
    ----------
    names : tuple of str
        For example link0/a4, tip_mass, link0/chamber1/gain, link0/bending_x/damping.
    nominal : ndarray (m,)
        Values of the robot file.
    polytope : Polytope
        Bounds, pairs and gains.
    config : CompleteAdaptation
        With a value for each key.

    Raises
    ------
    ConfigError
        If a parameter does not exist on this robot, or the robot's value is not admissible.
    """

    def __init__(self, arm: SoftArm, config: Adaptation, where: str = "controller", pieces: int = 1) -> None:
        self.arm, self.fields = arm, strain_fields(arm.robot)
        self.config = config = complete_adaptation(config, arm, where, pieces)
        columns: list[Column] = []
        lower: list[float] = []
        upper: list[float] = []
        gain: list[float] = []
        for group, g, low, high in zip(
            config.parameters, config.gain, config.lower, config.upper, strict=True
        ):
            found = _columns(arm, self.fields, group, where)
            columns += found
            lower += [low] * len(found)
            upper += [high] * len(found)
            gain += [g] * len(found)
        self.columns = tuple(columns)
        self.names = tuple(column.name for column in columns)
        self.nominal = np.array([column.nominal for column in columns])
        self.polytope = Polytope(
            np.array(lower), np.array(upper), np.array(gain), _pairs(arm, self.columns, config)
        )
        for i, column in enumerate(columns):
            if not lower[i] <= column.nominal <= upper[i]:
                allowed = f"bounds that hold the robot's value, {column.nominal:g}"
                raise ConfigError(where, f"adaptation.{column.group}", (lower[i], upper[i]), allowed)
        if not self.polytope.contains(self.nominal):
            raise ConfigError(
                where, "adaptation", "a margin that the robot's own values violate", "a smaller margin"
            )
        self._groups = {
            group: (
                np.array([i for i, c in enumerate(columns) if c.group == group]),
                np.array([c.index for c in columns if c.group == group]),
            )
            for group in config.parameters
        }
        self._has_elastic = any(group in _ELASTIC for group in config.parameters)
        self._masses = np.array([arm.robot.tip_mass, *(link.mass for link in arm.robot.links)])

    @property
    def size(self) -> int:
        """Number of adapted parameters."""
        return len(self.columns)

    def named(self, estimate: Array) -> dict[str, float]:
        """Return the estimates (m,) by name."""
        return {name: float(value) for name, value in zip(self.names, estimate, strict=True)}

    def model_force(self, q: Array, qd: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Return M a + C v + G + f_e + R v and its regressor, docs/model.md (37).

        Parameters
        ----------
        q, qd : ndarray (n_q,)
            Coordinates and their rates.
        v, a : ndarray (n_q,)
            Reference velocity and acceleration.

        Returns
        -------
        force : ndarray (n_q,)
            Generalised force with the parameters of the robot file.
        regressor : ndarray (n_q, m)
            Y. Columns of chamber gains are zero: they multiply the pressures, see `gain_regressor`.
        """
        mass = self.arm.mass_regressor(q, qd, v, a)
        # The regressor has no column for point masses.
        inertial = (
            self.arm.inverse_dynamics(q, qd, v, a) if self.arm.robot.point_masses else mass @ self._masses
        )
        force = inertial + self.arm.elastic_force(q) + self.arm.damping_force(q, v)
        regressor = np.zeros((self.arm.n_q, self.size))
        elastic = self.arm.elastic_regressor(q) if self._has_elastic else np.zeros((self.arm.n_q, 0))
        for group, (at, index) in self._groups.items():
            if group in _ELASTIC:
                regressor[:, at] = elastic[:, index]
            elif group in ("tip_mass", "link_mass"):
                regressor[:, at] = mass[:, index]
            elif group.startswith("damping"):
                regressor[:, at] = (self.fields.weight @ v)[:, None] * (self.fields.index[:, None] == index)
        return force, regressor

    def gains(self, estimate: Array) -> Array:
        """Return the gain of each chamber (n_u,), 1 if it is not adapted."""
        factor = np.ones(self.arm.n_u)
        if "chamber_gain" in self._groups:
            at, index = self._groups["chamber_gain"]
            factor[index] = estimate[at]
        return factor

    def gain_regressor(self, actuation: Array, pressure_pa: Array) -> Array:
        """Return the regressor (n_q, m) of the chamber gains: -H_j p_j in their columns, else zero."""
        regressor = np.zeros((self.arm.n_q, self.size))
        if "chamber_gain" in self._groups:
            at, index = self._groups["chamber_gain"]
            regressor[:, at] = -actuation[:, index] * pressure_pa[index]
        return regressor


def _columns(arm: SoftArm, fields: StrainFields, group: str, where: str) -> list[Column]:
    robot = arm.robot
    if group in _ELASTIC:
        place = _ELASTIC.index(group)
        found = []
        for i, link in enumerate(robot.links):
            if link.k_e is None or link.k_b is None:
                raise ConfigError(
                    where, "adaptation.parameters", group, "links with k_e and k_b, not a material"
                )
            value = (*link.k_e[:2], *link.k_b[:2])[place]
            found.append(Column(f"link{i}/{group}", group, 4 * i + place, float(value)))
        return found
    if group == "tip_mass":
        return [Column("tip_mass", group, 0, float(robot.tip_mass))]
    if group == "link_mass":
        return [Column(f"link{i}/mass", group, 1 + i, float(link.mass)) for i, link in enumerate(robot.links)]
    if group == "chamber_gain":
        return [Column(f"{name}/gain", group, j, 1.0) for j, name in enumerate(robot.chamber_names)]
    stretch = group == "damping_stretch"
    return [
        Column(f"link{link}/{strain}/damping", group, i, _uniform_damping(arm, fields, i))
        for i, (link, strain) in enumerate(zip(fields.links, fields.strains, strict=True))
        if (strain in STRETCHES) == stretch
    ]


def complete_adaptation(
    config: Adaptation, arm: SoftArm, where: str = "controller", pieces: int = 1
) -> CompleteAdaptation:
    """Return the keys of the adaptation with what is not stated found from the model.

    Parameters
    ----------
    config : Adaptation
        Keys as they are stated.
    arm : SoftArm
        Its links give the bounds, its stiffness the unit of the gain.
    where : str
        File that errors name.
    pieces : int
        Number of pieces into which each link is discretised.

    Raises
    ------
    ConfigError
        If the gain is not stated and a coordinate has no stiffness, or the bounds are in the wrong order.
    """
    stated = {name: value for name in Adaptation.model_fields if (value := getattr(config, name)) is not None}
    missing = {"gain", "lower", "upper"} - stated.keys()
    if not missing:
        return parse(stated, CompleteAdaptation, where)
    deviation, _, most = mass_prior(arm)
    found: dict[str, Any] = {"lower": (0.0,), "upper": (arm.robot.tip_mass + most,)}
    if "gain" in missing:
        try:
            found["gain"] = (follow_rate(deviation, arm, scales_of(arm, pieces)),)
        except ConfigError as error:
            raise ConfigError(where, "adaptation.gain", None, f"a stated gain: {error.got}") from None
    return parse(found | stated, CompleteAdaptation, f"{where}: adaptation")


def _uniform_damping(arm: SoftArm, fields: StrainFields, field: int) -> float:
    """Return the largest rho with R >= rho W: the rest of R dissipates for every estimate of rho."""
    at = np.ix_(fields.index == field, fields.index == field)
    root = np.linalg.inv(np.linalg.cholesky(fields.weight[at]))
    return float(np.linalg.eigvalsh(root @ arm.damping_matrix()[at] @ root.T)[0])


def _pairs(arm: SoftArm, columns: tuple[Column, ...], config: Adaptation) -> tuple[Pair, ...]:
    """Return the constraints that keep a1 - a2 and a4 - a5 positive if one of the pair is adapted."""
    at = {column.name: i for i, column in enumerate(columns)}
    pairs = []
    for i, link in enumerate(arm.robot.links):
        if link.k_e is None or link.k_b is None:
            continue
        for high, low, values, margin in (
            ("a1", "a2", link.k_e, config.margin_stretch_n_m),
            ("a4", "a5", link.k_b, config.margin_bend_n_m_rad),
        ):
            h, j = at.get(f"link{i}/{high}", -1), at.get(f"link{i}/{low}", -1)
            if h >= 0 or j >= 0:
                pairs.append(Pair(h, j, margin, float(values[0]), float(values[1])))
    return tuple(pairs)
