"""The final part on a mesh of its own shape: does it hold air, how thin is it, how far does it move?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates

from soro_core.arrays import Array, Flags, Integers
from soro_core.errors import ModelError
from soro_design.fem import Mesh, SolverSettings, make_part, no_loads, solve
from soro_design.fem.elements.solid import tables
from soro_design.fem.solve.stretches import greatest_stretch
from soro_design.topology.domain import NEAR, Domain, held_nodes, inlet_key, inside, output_at, output_weights
from soro_design.topology.flood import Flood, flood, thinnest_wall, wet_faces
from soro_design.topology.goals import Farthest
from soro_design.topology.physics.grid import place_text
from soro_design.topology.shape import Contour, contour, solid_mesh
from soro_design.topology.state import OptimiserState


@dataclass(frozen=True, eq=False)
class Reanalysis:
    """The part of a mesh of its own shape under the last pressure.

    Attributes
    ----------
    motion_m : float
        Of the output against its spring [m], NaN where there is no equilibrium.
    free_m : float
        Without a spring [m], NaN where there is no equilibrium.
    u, free_u : ndarray, (n, d)
        Displacements of both [m], of the last state in equilibrium.
    cause : str
        Why there is no equilibrium, else empty.
    stretch : float
        Greatest principal stretch at a point of integration, with the spring.
    turn : float
        How far the output turns from y to x in a section without spring [rad]; NaN of rings and solids.
    """

    motion_m: float
    free_m: float
    u: Array
    free_u: Array
    cause: str
    stretch: float
    turn: float


@dataclass(frozen=True, eq=False)
class FinalPart:
    """The final part.

    Attributes
    ----------
    cut : Contour
        Border of its solid.
    mesh : Mesh
        Of its solid.
    air : Flood
        What is wet.
    wet, outer : ndarray of int, (f, m)
        Faces that the air of the inlet presses on, and those in the open.
    wall_m : float
        Least distance between them [m].
    wall_at : ndarray, (d,)
        Where that is [m].
    full : str
        Name of the first inlet that is full of solid, else empty.
    is_stiff : ndarray of bool, (c,), or None
        Elements of the mesh that are of the second material; None without one.
    """

    cut: Contour
    mesh: Mesh
    air: Flood
    wet: Integers
    outer: Integers
    wall_m: float
    wall_at: Array
    full: str = ""
    is_stiff: Flags | None = None

    @property
    def volume_m3(self) -> float:
        """Volume of its solid; a section is 1 m thick."""
        return float(tables(self.mesh, self.mesh.cells)[2].sum())

    @property
    def stiff_m3(self) -> float:
        """Volume of the second material in it, 0 without one."""
        if self.is_stiff is None:
            return 0.0
        return float(tables(self.mesh, self.mesh.cells[self.is_stiff])[2].sum())

    @property
    def leak(self) -> str:
        """Why it does not hold air, else empty."""
        if self.air.is_leak.any():
            at = place_text(self.cut.points[np.flatnonzero(self.air.is_leak)[0]])
            return f"the part is not sealed: air of the inlet reaches the open at {at}"
        if self.air.is_full.any():
            return f"{self.full} is full of solid: no air gets in"
        return ""


def shape(domain: Domain, state: OptimiserState) -> FinalPart:
    """Return the final part of a run."""
    found = final_part(domain, contour(domain, state.filtered))
    if domain.stiffening is None:
        return found
    return replace(found, is_stiff=stiff_cells(domain, state.stiff, found.mesh))


def stiff_cells(domain: Domain, stiff: Array, mesh: Mesh) -> Flags:
    """Return which elements (c,) of a mesh are of the second material, by its share at their centres.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    stiff : ndarray, (e,)
        Shares of the second material in the elements of the grid.
    mesh : Mesh
        Of the solid.
    """
    grid = domain.grid
    centres = mesh.points[mesh.cells].mean(axis=1) / np.array(grid.edge_m) - 0.5
    share = map_coordinates(stiff.reshape(grid.counts), centres.T, order=1, mode="nearest")
    return np.asarray(share >= 0.5)


def final_part(domain: Domain, cut: Contour) -> FinalPart:
    """Return the part with a contour."""
    mesh = solid_mesh(domain, cut)
    air = flood(domain, cut)
    wet, outer = wet_faces(domain, cut, air, mesh)
    full = inlet_key(domain.task, int(air.is_full.argmax())) if air.is_full.any() else ""
    return FinalPart(cut, mesh, air, wet, outer, *thinnest_wall(mesh, wet, outer), full)


def reanalyse(domain: Domain, found: FinalPart) -> Reanalysis:
    """Return how far the output of the final part moves, with its spring and without.

    Raises
    ------
    ModelError
        If the goal is not a motion, or the solid does not reach the output.
    """
    if found.is_stiff is None or domain.stiffening is None:
        return moved_output(domain, found.mesh, found.wet)
    stiffer = np.where(found.is_stiff, domain.stiffening.times, 1.0)
    return moved_output(domain, found.mesh, found.wet, stiffer=stiffer)


def moved_output(
    domain: Domain, mesh: Mesh, wet: Integers, depth_m: float | None = None, stiffer: ArrayLike = 1.0
) -> Reanalysis:
    """Return how far the output of a mesh moves, with its spring and, without a depth, without it too.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    mesh : Mesh
        In the space of the task, or a solid of such a depth along z from its plane of symmetry z = 0.
    wet : ndarray of int, (f, m)
        Faces that the air presses on.
    depth_m : float, optional
        Of a solid for a task in plane strain [m]: its spring is as deep, and what one key `held` holds
        along x and y it holds along z too.
    stiffer : array-like, (c,) or one number
        How many times as stiff as the first material each element is.

    Raises
    ------
    ModelError
        If the goal is not a motion, or the solid does not reach the output.
    """
    task = domain.task
    goal = task.goal
    if not isinstance(goal, Farthest):
        raise ModelError("a goal without an output has no motion; allowed: goal.kind farthest", "goal")
    near = NEAR * min(domain.grid.edge_m)
    is_held = held_nodes(task, mesh.points, near)
    if depth_m is not None:
        clamped = [one.where for one in task.held if {"x", "y"} <= set(one.along)]
        is_held[:, 2] = np.any(
            [mesh.points[:, 2] == 0.0, *(inside(r, mesh.points, near) for r in clamped)], 0
        )
    loads = no_loads(mesh)
    for axis, of_axis in enumerate(is_held.T):
        loads = loads.hold(of_axis, axis)
    if len(wet):
        # The flood has named leaks; the mouth of the inlet is open.
        loads = loads.press(wet, task.schedule.pressure_pa[1], is_patch=True)
    weights = output_weights(goal, mesh, near)
    part = make_part(mesh, goal.law("goal.material"), loads, stiffer=stiffer)
    moved, causes = [], []
    for spring in (goal.spring_pa, 0.0) if depth_m is None else (goal.spring_pa * depth_m,):
        sprung = part.under(loads.spring(spring * np.abs(weights)))
        done = solve(sprung, settings=SolverSettings(tolerance=1e-8, iterations=20))
        reached = float((weights * done.last.u).sum()) if done.status == "solved" else np.nan
        moved.append((reached, done.last.u))
        causes.append(done.cause)
    (motion, u), (free, free_u) = moved[0], moved[1] if len(moved) > 1 else (np.nan, moved[0][1])
    cause = "; ".join(cause for cause in causes if cause)
    is_section = mesh.space == "plane_strain" and np.isfinite(free)
    is_there, _ = output_at(goal, mesh.points, near)
    turn = turn_of(mesh.points[is_there], free_u[is_there]) if is_section else np.nan
    return Reanalysis(motion, free, u, free_u, cause, greatest_stretch(part, u), turn)


def turn_of(points: Array, u: Array) -> float:
    """Return the angle [rad] by which points turn from y to x, least squares.

    Parameters
    ----------
    points, u : ndarray, (n, 2)
        Places and displacements [m].
    """
    before, after = points - points.mean(axis=0), points + u - (points + u).mean(axis=0)
    across = after[:, 0] * before[:, 1] - after[:, 1] * before[:, 0]
    return float(np.arctan2(across.sum(), (before * after).sum()))
