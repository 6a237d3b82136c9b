"""How a robot is discretised for computing: the shape functions of its strains, pieces of links, quadrature.

Plain values: what a scene writes, what a node gets as parameters, and what a study of speed and accuracy
varies. 0 (or `robot`) leaves the choice to the robot.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

from pydantic import Field, field_validator, model_validator

from soro_core.config import Strict
from soro_core.errors import ConfigError
from soro_core.robot.bases import BASES, listed, names
from soro_core.robot.description import Robot
from soro_core.robot.link import Link
from soro_core.robot.parts import fields
from soro_core.robot.strain import MAX_ORDER

Integrator: TypeAlias = Literal[
    "trapezoidal", "rk4", "midpoint_linear", "midpoint", "tr_bdf2", "tr_bdf2_linear", "dopri5"
]
"""Names of `soro_core.integrate.STEPPERS`, for modules that do not import the steppers."""
EXPLICIT: tuple[Integrator, ...] = ("rk4", "dopri5")
"""Those that take no air behind valves."""


class Discretisation(Strict):
    """Shape functions, pieces of links and quadrature; the defaults leave the robot as its file has it."""

    method: Literal["exact", "mde"] = Field("exact", description="integration along the backbone")
    nodes: int = Field(
        0, ge=0, le=64, description="exact: quadrature nodes a link; 0: chosen for the robot, else 2 or more"
    )
    steps: int = Field(0, ge=0, le=1000, description="mde: steps a link; 0: the model's default")
    links: int = Field(1, ge=1, le=64, description="pieces that each link of the robot is split into")
    basis: str = Field(
        "robot", description="shape functions of every strain, on each piece; robot: as its file says"
    )
    order: int = Field(0, ge=0, le=MAX_ORDER, description="polynomial degree, of legendre and chebyshev")

    @field_validator("basis", mode="before")
    @classmethod
    def _known(cls, value: Any) -> str:
        allowed = ["robot", *_expanding()]
        if not isinstance(value, str) or value not in allowed:
            raise ValueError(listed(map(repr, allowed)))
        return value

    @model_validator(mode="after")
    def _together(self) -> Discretisation:
        if self.nodes == 1:
            raise ValueError("nodes: 0 or a number of 2 or more")
        if self.nodes and self.method != "exact":
            raise ValueError("no nodes with method mde, only with exact")
        if self.steps and self.method != "mde":
            raise ValueError("no steps with method exact, only with mde")
        ordered = names(lambda basis: "order" in basis.keys)
        if (self.basis in ordered) != bool(self.order):
            raise ValueError(f"an order of 1 or more with basis {listed(ordered, 'and')}, and only there")
        return self

    @property
    def quadrature(self) -> Discretisation:
        """The same method, nodes and steps on the robot as its file has it."""
        return Discretisation(method=self.method, nodes=self.nodes, steps=self.steps)

    def discretise(self, robot: Robot) -> Robot:
        """Return the robot with its links split and its strains expanded.

        Raises
        ------
        ConfigError
            If the robot has something that cannot be split or expanded.
        """
        pieces = robot.refine(self.links)
        return pieces if self.basis == "robot" else with_basis(pieces, self.basis, self.order)


def with_basis(robot: Robot, basis: str, order: int) -> Robot:
    """Expand every strain of every link in polynomials, or reduce it to a constant, of the same physics.

    A law of a link acts on the local strain already. Losses given for each coordinate of a constant strain
    are losses per unit of length, d / L: the Legendre polynomials are orthogonal, int P_a P_b =
    L / (2 a + 1), so that of the coefficient of P_a is d / (2 a + 1). Creep is linear and shares out alike.

    Parameters
    ----------
    robot : Robot
        With constant strains, or without losses given for each coordinate.
    basis : str
        A name in `soro_core.robot.bases.BASES` that takes no samples: constant, legendre, chebyshev.
    order : int
        Polynomial degree; not of constant.

    Raises
    ------
    ConfigError
        If the basis is not one of these; if a strain has modes; if losses are given for each coordinate of
        a varying strain, or should be expanded in Chebyshev polynomials, which are not orthogonal; if a
        link has hysteresis, which is not linear.
    """
    if basis not in _expanding():
        raise ConfigError(robot.name, "basis", basis, listed(_expanding()))
    where = f"{robot.name}: basis {basis}"
    return robot.replace(
        links=[_expanded(link, basis, order, where, f"links[{i}]") for i, link in enumerate(robot.links)]
    )


def _expanding() -> list[str]:
    """Names of the bases that any link can be expanded in."""
    return names(lambda basis: basis.keys <= {"order"})


def _expanded(link: Link, basis: str, order: int, where: str, key: str) -> dict[str, Any]:
    was_constant = not link.varies
    wanted = BASES[basis]
    if not wanted.varies and was_constant:
        return fields(link)
    for name, field in link.strains.items():
        if not field.shape_functions.splits:
            raise ConfigError(where, f"{key}.strains.{name}.basis", field.basis, listed(_expanding()))
    lossy = any(link.damping or ()) or any(any(branch.stiffness) for branch in link.creep)
    if link.hysteresis:
        raise ConfigError(where, f"{key}.hysteresis", "hysteresis", "none: it acts on a constant strain only")
    if lossy and not was_constant:
        raise ConfigError(where, f"{key}.damping", "losses of each coordinate", "constant strains")
    if lossy and wanted.varies and not wanted.orthogonal:
        those = listed(names(lambda one: one.orthogonal))
        allowed = f"none given for each coordinate, or basis {those}: {basis} would couple them"
        raise ConfigError(where, f"{key}.damping", "losses of each coordinate", allowed)
    part = fields(link)
    shape: dict[str, Any] = {"basis": basis, **({"order": order} if "order" in wanted.keys else {})}
    part["strains"] = dict.fromkeys(link.strains, shape)

    def spread(values: tuple[float, ...], share: bool) -> list[float]:
        return [value / (2 * a + 1) if share else value for value in values for a in range(order + 1)]

    part.pop("damping", None)
    part.pop("creep", None)
    if lossy:
        part["damping"] = spread(link.damping or (0.0,) * len(link.strains), True)
        part["creep"] = [
            {
                "tau": spread(branch.tau, False) if len(branch.tau) > 1 else branch.tau,
                "stiffness": spread(branch.stiffness, True),
            }
            for branch in link.creep
        ]
    return part
