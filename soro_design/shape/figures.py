"""What a design reaches under its loads: the goal, the greatest stretch, or why it has no equilibrium."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.errors import ConfigError, ModelError
from soro_design.fem import EquilibriumState, SolverSettings, solve
from soro_design.fem.backbone import section_poses
from soro_design.fem.loads import spread_force
from soro_design.fem.part import Part
from soro_design.fem.solve.equations import Equations
from soro_design.fem.solve.stretches import greatest_stretch
from soro_design.parts.file import LoadSweep, PartFile
from soro_design.parts.mesh_specimen import MeshSpecimen
from soro_design.parts.specimen import RingSpecimen, RodSpecimen, make_specimen
from soro_design.shape.free_end import free_end, lid_force

# A design that needs shorter load steps is near a limit point: it counts as one without equilibrium.
SETTINGS = SolverSettings(least_step=0.02)
# Of each goal the unit of reports, and how many of it are one of the SI unit.
GOALS = {
    "stroke": ("mm", 1e3),
    "force": ("N", 1.0),
    "bend": ("deg", 180.0 / np.pi),
    "stiffness": ("N/mm", 1e-3),
}


@dataclass(frozen=True, eq=False)
class DesignFigures:
    """What a design reaches.

    Attributes
    ----------
    goal : float
        Stroke [m], force [N], bend [rad] or stiffness [N/m].
    stretch : float
        Greatest principal stretch.
    u : ndarray, (n, d)
        Displacements [m].
    cause : str
        Why there is no equilibrium; the rest then has no meaning.
    """

    goal: float
    stretch: float
    u: Array
    cause: str = ""


def figures(goal: str, sweep: LoadSweep, file: PartFile) -> DesignFigures:
    """Return what a design reaches under the loads of a sweep, whose extension does not count.

    The end is where a part is not held. `stroke` is how far it moves, `bend` how far it turns, `force` what
    holds it where it is, and `stiffness` a small force along the stroke over the motion that it makes. About
    an axis a rigid lid closes the end.

    Parameters
    ----------
    goal : str
        One of GOALS; a part about an axis has no bend.
    sweep : LoadSweep
    file : PartFile
        The design.
    """
    try:
        specimen = make_specimen(file)
        if isinstance(specimen, RingSpecimen):
            return _of_ring(goal, sweep, specimen)
        return _of_solid(goal, sweep, specimen)
    except (ModelError, ConfigError) as error:
        return DesignFigures(np.nan, np.nan, np.empty(0), str(error))


def _of_ring(goal: str, sweep: LoadSweep, specimen: RingSpecimen) -> DesignFigures:
    if goal == "force":
        state = _settled(specimen.under(with_changes(sweep, extension_m=0.0)))
        lid = lid_force(specimen, state.u, sum(sweep.pressures_pa))[0]
        value, u = lid - float(state.reaction[specimen.tip, 1].sum()), state.u
    else:
        found = free_end(specimen, sweep)
        value = float(found.u[specimen.tip, 1].mean()) if goal == "stroke" else found.stiffness_n_m
        u = found.u
    return _with_stretch(specimen.part, value, u)


def _of_solid(goal: str, sweep: LoadSweep, specimen: RodSpecimen | MeshSpecimen) -> DesignFigures:
    faces = specimen.forced if isinstance(specimen, MeshSpecimen) else specimen.tip
    part = specimen.under(sweep)
    end = np.unique(faces)
    if goal == "force":
        loads = part.loads
        for direction in range(3):
            loads = loads.hold(end, direction)
        state = _settled(part.under(loads))
        return _with_stretch(part, float(np.linalg.norm(state.reaction[end].sum(axis=0))), state.u)
    u = _settled(part).u
    moved = u[end].mean(axis=0)
    value = float(np.linalg.norm(moved))
    if goal == "bend":
        pose = section_poses(part.mesh.points, u, end[None], np.ones(len(end)))[0]
        value = float(np.arccos(np.clip(pose[2, 2], -1.0, 1.0)))
    if goal == "stiffness":
        push = spread_force(part.mesh, faces, moved / value)
        tangent = Equations(part).tangent(part.balance(u, 1.0), u)
        move = None if tangent is None else tangent.move(push, np.zeros_like(u))
        if move is None:
            raise ModelError("the stiffness is singular", "stiffness")
        value = 1.0 / float((push * move).sum())
    return _with_stretch(part, value, u)


def _settled(part: Part) -> EquilibriumState:
    done = solve(part, (1.0,), SETTINGS)
    if done.cause:
        raise ModelError(done.cause, "pressures_pa")
    return done.last


def _with_stretch(part: Part, value: float, u: Array) -> DesignFigures:
    return DesignFigures(value, greatest_stretch(part, u), u)


def without_shape(found: DesignFigures) -> DesignFigures:
    """Return the figures without displacements, which a search does not need."""
    return replace(found, u=np.empty(0))
