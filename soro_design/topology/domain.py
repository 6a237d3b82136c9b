"""From a task to its grid: which elements are given, which nodes are held, pressed, open and wanted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from soro_core.arrays import Array, Flags, Integers
from soro_core.errors import ConfigError, ModelError
from soro_design.fem import Mesh
from soro_design.topology.goals import Box, Disc, Farthest, Stiffening, Stiffest
from soro_design.topology.physics.compliance import Compliance
from soro_design.topology.physics.darcy import Flow
from soro_design.topology.physics.grid import Grid, make_grid, place_text
from soro_design.topology.physics.stroke import Stroke
from soro_design.topology.task import Task

# Nodes this close to the border of a region belong to it, in edges of elements.
NEAR = 1e-6


@dataclass(frozen=True, eq=False)
class Domain:
    """A task on its grid; make one with `make_domain`.

    Attributes
    ----------
    task : Task
        The task.
    grid : Grid
        Its grid.
    is_solid, is_void : ndarray of bool, (e,)
        Elements that stay so.
    inlets : ndarray of bool, (i, n)
        Nodes at full pressure, of each inlet.
    is_open : ndarray of bool, (n,)
        Nodes at none.
    is_held : ndarray of bool, (n, d)
        Directions in which nodes do not move.
    output : ndarray, (n, d)
        Weights of the displacements that make that of the output; 0 where the goal has none.
    stretch_limit : float or None
        Greatest principal stretch.
    """

    task: Task
    grid: Grid
    is_solid: Flags
    is_void: Flags
    inlets: Flags
    is_open: Flags
    is_held: Flags
    output: Array
    stretch_limit: float | None = None

    @property
    def is_inlet(self) -> Flags:
        """Nodes at full pressure, (n,) of bool."""
        return np.asarray(self.inlets.any(axis=0))

    @property
    def is_given(self) -> Flags:
        """Elements that do not change, (e,) of bool."""
        return np.asarray(self.is_solid | self.is_void)

    @property
    def stiffening(self) -> Stiffening | None:
        """The second material, if there is one."""
        return self.task.goal.stiff if isinstance(self.task.goal, Farthest) else None

    @property
    def fields(self) -> int:
        """Fields of design variables: densities, and with a second material its shares."""
        return 1 if self.stiffening is None else 2

    def start(self) -> Array:
        """Return the design variables (fields e,) of the first iteration."""
        x = np.full(len(self.is_solid), self.task.volume_fraction)
        for one in self.task.start:
            x[inside(one.where, self.grid.centres, 0.0)] = one.density
        x[self.is_solid], x[self.is_void] = 1.0, 0.0
        if self.stiffening is None:
            return x
        return np.concatenate([x, np.full(len(x), self.stiffening.volume_fraction)])


def make_domain(task: Task, where: str = "task") -> Domain:
    """Return a task on its grid.

    Parameters
    ----------
    task : Task
        The task.
    where : str
        File that errors name.

    Raises
    ------
    ConfigError
        If a region holds nothing, or the output cannot move.
    """
    grid = make_grid(task.space, task.size_m, task.cells)
    points, centres = grid.mesh.points, grid.centres
    near = NEAR * min(grid.edge_m)

    def nodes(region: Box | Disc, key: str) -> Flags:
        found = inside(region, points, near)
        if not found.any():
            raise ConfigError(
                where, key, _told(region), f"a region with nodes of the grid, {size_text(task)}"
            )
        return found

    def elements(region: Box | Disc, key: str) -> Flags:
        found = inside(region, centres, 0.0)
        if not found.any():
            allowed = f"a region with centres of elements, {size_text(task)}"
            raise ConfigError(where, key, _told(region), allowed)
        return found

    def given(regions: tuple[Box | Disc, ...], key: str) -> Flags:
        every = np.zeros(len(centres), dtype=bool)
        for k, region in enumerate(regions):
            every |= elements(region, f"{key}[{k}]")
        return every

    inlets = np.array([nodes(region, inlet_key(task, k)) for k, region in enumerate(task.inlet)])
    is_inlet, is_open = np.asarray(inlets.any(axis=0)), np.zeros(len(points), dtype=bool)
    for k, region in enumerate(task.open):
        is_open |= nodes(region, f"open[{k}]")
    is_open &= ~is_inlet
    if not is_open.any():
        got = "no region" if not task.open else "regions within the inlet alone"
        raise ConfigError(where, "open", got, "a region beside the inlet")
    for k, one in enumerate(task.held):
        nodes(one.where, f"held[{k}].where")
    is_held = held_nodes(task, points, near)
    is_solid, is_void = given(task.solid, "solid"), given(task.void, "void")
    for k, one_start in enumerate(task.start):
        elements(one_start.where, f"start[{k}].where")
    if (is_solid & is_void).any():
        place = place_text(centres[np.flatnonzero(is_solid & is_void)[0]])
        raise ConfigError(where, "void", place, "elements that are not solid too")
    if grid.volumes[is_solid].sum() > task.volume_fraction * grid.volumes.sum():
        raise ConfigError(where, "volume_fraction", task.volume_fraction, "more than the share in `solid`")
    output = np.zeros(points.shape)
    if isinstance(task.goal, Farthest):
        for k, region in enumerate(task.goal.output):
            key = _key("goal.output", task.goal.output, k)
            is_there = nodes(region, key)
            try:
                grid.mesh.faces_at(is_there)
            except ModelError:
                allowed = "faces of the border, no single node and nothing inside"
                raise ConfigError(where, key, _told(region), allowed) from None
        told = "; ".join(str(_told(region)) for region in task.goal.output)
        output = output_weights(task.goal, grid.mesh, near)
        if not (output[~is_held] != 0.0).any():
            allowed = "an output that can move: `held` holds all of it in that direction"
            raise ConfigError(where, "goal.output", told, allowed)
        output = np.where(is_held, 0.0, output)
        moved = joined(grid.mesh.cells[~is_void], (output != 0.0).any(axis=1))
        if not (moved & (joined(grid.mesh.cells[is_void], is_inlet) | is_inlet)).any():
            allowed = "elements that leave a way for material from goal.output to the air of the inlet"
            raise ConfigError(where, "void", f"{len(task.void)} regions that part them", allowed)
    limit = _stretch_limit(task, where)
    return Domain(task, grid, is_solid, is_void, inlets, is_open, is_held, output, limit)


def inlet_key(task: Task, k: int) -> str:
    """Return what errors call an inlet."""
    return _key("inlet", task.inlet, k)


def _key(name: str, regions: tuple[Box | Disc, ...], k: int) -> str:
    """The key of one of several regions, or of the only one."""
    return name if len(regions) == 1 else f"{name}[{k}]"


def _stretch_limit(task: Task, where: str) -> float | None:
    """The limit of the task, else the stretch at which its material breaks."""
    if task.stretch_limit is not None or isinstance(task.goal, Stiffest):
        return task.stretch_limit
    known = task.goal.law(where).strength
    return None if known is None else known.break_stretch


def _told(region: Box | Disc) -> dict[str, Any]:
    """Return the keys of a region as its file has them."""
    return region.model_dump(exclude_none=True)


def analysis(domain: Domain, where: str = "task") -> Stroke | Compliance:
    """Return what the goal of a task is computed with; `where` is named in errors."""
    task, grid = domain.task, domain.grid
    air = task.air
    flow = Flow(air.threshold, air.sharpness, air.contrast, air.depth_m)
    held = np.where(domain.is_inlet, 1.0, np.where(domain.is_open, 0.0, np.nan))
    goal = task.goal
    if isinstance(goal, Stiffest):
        nu = goal.poisson_ratio
        return Compliance(grid, flow, held, domain.is_held, goal.youngs_modulus_pa, nu, task.void_stiffness)
    # A spring of the patch, shared by the weights of its nodes.
    spring = goal.spring_pa * np.abs(domain.output)
    return Stroke(
        grid,
        flow,
        held,
        domain.is_held,
        goal.law(where),
        task.void_stiffness,
        domain.output,
        spring,
        goal.energy_exponent,
        1.0 if goal.stiff is None else goal.stiff.times,
    )


def inside(region: Box | Disc, points: Array, near: float) -> Flags:
    """Return which points lie in a region, (n,) of bool.

    Parameters
    ----------
    region : Box or Disc
        The region.
    points : ndarray, (n, d)
        Points [m].
    near : float
        Distance from its border that still counts [m].
    """
    if isinstance(region, Box):
        found = np.ones(len(points), dtype=bool)
        for k, side in enumerate((region.x_m, region.y_m, region.z_m)):
            if side is not None:
                found &= (points[:, k] >= side[0] - near) & (points[:, k] <= side[1] + near)
        return found
    # Of a solid above a section a disc is a cylinder.
    gap = points[:, : len(region.centre_m)] - np.asarray(region.centre_m)
    return np.asarray(np.linalg.norm(gap, axis=1) <= region.radius_m + near)


def joined(cells: Integers, seeds: Flags) -> Flags:
    """Return which nodes (n,) elements (e, a) join with those of `seeds` (n,)."""
    n, last = len(seeds), cells.shape[1] - 1
    pairs = np.concatenate([cells[:, k : k + 2] for k in range(last)])
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    return np.asarray(np.isin(label, label[seeds]))


def held_nodes(task: Task, points: Array, near: float) -> Flags:
    """Return the directions in which points do not move, (n, d) of bool.

    Parameters
    ----------
    task : Task
        The task.
    points : ndarray, (n, d)
        Points [m].
    near : float
        Distance from the border of a region that still counts [m].
    """
    is_held = np.zeros(points.shape, dtype=bool)
    for one in task.held:
        found = inside(one.where, points, near)
        for axis in one.along:
            is_held[found, "xyz".index(axis)] = True
    if task.space == "axisymmetric":
        is_held[points[:, 0] < near, 0] = True
    return is_held


def size_text(task: Task) -> str:
    """Return the size of the grid in words."""
    return " and ".join(
        f"0 to {size:g} m along {axis}" for axis, size in zip("xyz", task.size_m, strict=False)
    )


def output_at(goal: Farthest, points: Array, near: float) -> tuple[Flags, Array]:
    """Return which points (n,) are of the output, and unit vectors (n, d) along which their motion counts.

    Parameters
    ----------
    goal : Farthest
        With a direction, or a point to turn about.
    points : ndarray, (n, d)
        Points [m]; d may be 3 for a goal of a section.
    near : float
        Distance from the border of a region that still counts [m].
    """
    is_there = np.any([inside(region, points, near) for region in goal.output], axis=0)
    along = np.zeros(points.shape)
    if goal.about_m is None:
        assert goal.direction is not None
        along[:, : len(goal.direction)] = goal.direction
    else:
        x, y = (points[:, :2] - goal.about_m).T
        along[:, :2] = np.stack([-y, x], axis=1)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    return is_there, along / np.where(length > 0.0, length, 1.0)


def output_weights(goal: Farthest, mesh: Mesh, near: float) -> Array:
    """Return weights (n, d) that make the mean motion of the output, a patch of the border of a mesh.

    Parameters
    ----------
    goal : Farthest
        The goal.
    mesh : Mesh
        The mesh, in the space of the task or a solid above its section.
    near : float
        Distance from the border of a region that still counts [m].

    Raises
    ------
    ModelError
        If no face of the border has all its nodes there.
    """
    is_there, along = output_at(goal, mesh.points, near)
    faces = mesh.faces_at(is_there)
    weight = np.zeros(len(mesh.points))
    # With middles of edges the mean is that of these: of a triangle exactly, else of what is linear.
    counted = faces[:, faces.shape[1] // 2 :] if faces.shape[1] > 4 else faces
    np.add.at(weight, counted, np.linalg.norm(normals(mesh.points, faces), axis=1)[:, None])
    return np.asarray((weight / weight.sum())[:, None] * along)


def normals(points: Array, faces: Integers) -> Array:
    """Return the outward normals (f, d) of flat faces (f, m), as long as these are long or large.

    Parameters
    ----------
    points : ndarray, (n, d)
        Corners [m].
    faces : ndarray of int, (f, 2, 4, 6 or 8)
        Lines, quadrilaterals, triangles with middles or quadrilaterals with them, turned outwards.
    """
    ends = points[faces]
    if faces.shape[1] == 2:
        along = ends[:, 1] - ends[:, 0]
        return np.stack([along[:, 1], -along[:, 0]], axis=1)
    last = 0 if faces.shape[1] == 6 else 3
    return np.asarray(0.5 * np.cross(ends[:, 2] - ends[:, 0], ends[:, last] - ends[:, 1]))
