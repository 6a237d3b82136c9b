"""One way to compute a robot in time: its discretisation, time stepper and step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import yaml

from soro_core.robot import Discretisation


@dataclass(frozen=True)
class Candidate:
    """A combination that is measured.

    Attributes
    ----------
    model : Discretisation
        Shape functions, pieces of links, quadrature.
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
        """The section `model` of a scene that asks for it."""
        stated = self.model.model_dump(exclude_defaults=True)
        return {"method": self.model.method, **stated, "integrator": self.integrator, "dt_s": self.dt_s}

    @property
    def block(self) -> str:
        """The same as YAML, ready to paste."""
        return str(yaml.safe_dump({"model": self.section}, sort_keys=False))

    @property
    def space(self) -> str:
        """Shape functions and pieces of a link in short: ``legendre 2 x 4``."""
        return describe(self.model)

    @property
    def quadrature(self) -> str:
        """Method with its nodes or steps: ``exact``, ``exact 4``, ``mde 20``."""
        model = self.model
        return f"{model.method} {model.nodes or model.steps or ''}".strip()

    def __str__(self) -> str:
        return f"{self.space}, {self.quadrature}, {self.integrator} {1e3 * self.dt_s:g} ms"


def describe(model: Discretisation) -> str:
    """Shape functions and pieces of a link: ``legendre 2 x 4`` has quadratic polynomials on four pieces."""
    basis = "as robot" if model.basis == "robot" else model.basis
    order = f" {model.order}" if model.order else ""
    return f"{basis}{order} x {model.links}"
