"""A candidate of the trade: discretisation of a robot, time stepper and step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import yaml

from soro_core.robot import Discretisation


@dataclass(frozen=True)
class Candidate:
    """A combination of discretisation, time stepper and step.

    Attributes
    ----------
    model : Discretisation
        Shape functions, pieces of each link, quadrature.
    integrator : str
        One of `soro_core.integrate.STEPPERS`.
    dt_s : float
        Time step [s].
    """

    model: Discretisation
    integrator: str
    dt_s: float

    @property
    def section(self) -> dict[str, Any]:
        """Section `model` of a scene with this candidate."""
        stated = self.model.model_dump(exclude_defaults=True)
        return {"method": self.model.method, **stated, "integrator": self.integrator, "dt_s": self.dt_s}

    @property
    def block(self) -> str:
        """The section as YAML."""
        return str(yaml.safe_dump({"model": self.section}, sort_keys=False))

    @property
    def space(self) -> str:
        """Short text of shape functions and pieces of a link: ``legendre 2 x 4``."""
        return describe(self.model)

    @property
    def quadrature(self) -> str:
        """Short text of method and nodes or steps: ``exact``, ``exact 4``, ``mde 20``."""
        model = self.model
        return f"{model.method} {model.nodes or model.steps or ''}".strip()

    def __str__(self) -> str:
        return f"{self.space}, {self.quadrature}, {self.integrator} {1e3 * self.dt_s:g} ms"


def describe(model: Discretisation) -> str:
    """Return the short text: ``legendre 2 x 4`` for quadratic polynomials on four pieces of a link."""
    basis = "as robot" if model.basis == "robot" else model.basis
    order = f" {model.order}" if model.order else ""
    return f"{basis}{order} x {model.links}"
