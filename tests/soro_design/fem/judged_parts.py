"""Six parts that an independent library has solved too, with its figures; for tests and benchmarks.

That library is under the GPL, so none of its code is here: its figures are those of equal load steps, on the
same meshes. Values of ring and block, which it did not leave, are ours, on other ways of load steps.
"""

from typing import NamedTuple

import numpy as np

from soro_design.fem import (
    Bellows,
    Contact,
    Obstacle,
    bellows_mesh,
    block,
    load_material,
    make_mesh,
    make_part,
    material_from_dict,
    no_loads,
    tube,
)


class Judged(NamedTuple):
    """Iterations and CPU seconds of the other library, and displacements [m] and forces [N] of `values`."""

    iterations: int
    cpu_s: float
    values: tuple[float, ...]


OTHER = {
    "tube": Judged(19, 0.92, (0.0019098729240035943, -0.5302499884824157)),
    "beam": Judged(37, 0.94, (-0.026878948773730368, 0.062077221639992824)),
    "bellow": Judged(24, 0.26, (-1.2607785928737099, 0.0007049750200776994)),
    "pneunet": Judged(23, 2.39, (6.14743236207424e-05, 7.659378553104007e-06, 3.0498511766528045e-05)),
    "ring": Judged(42, 0.32, (16.35204800723391, 0.00171253597709941)),
    "block": Judged(20, 4.15, (526063.1698950022, 200642.99496784463)),
}


def rubber(**constants):
    return material_from_dict({"kind": "hyperelastic", "source": "a comparison", **constants})


def clamped(mesh, nodes):
    """Loads that hold nodes in all directions."""
    loads = no_loads(mesh)
    for k in range(mesh.points.shape[1]):
        loads = loads.hold(nodes, k)
    return loads


def thick_tube():
    """A quarter of a tube of 720 hex8 under 30 kPa inside."""
    mesh = tube("hex8", (6, 12, 6), (4e-3, 8e-3), 20e-3)
    x, y, z = mesh.points.T
    loads = no_loads(mesh).hold(x == 0, 0).hold(y == 0, 1).hold(z == 0, 2).hold(z == z.max(), 2)
    inside = mesh.faces_at(np.abs(np.hypot(x, y) - 4e-3) < 1e-8)
    return make_part(mesh, load_material("dragonskin_10"), loads.press(inside, 30e3))


def beam():
    """A cantilever of 80 hex20 that its tip force bends by 62 % of its length."""
    mesh = block("hex20", "solid", (20, 2, 2), (0.1, 0.01, 0.01))
    tip = mesh.points[:, 0] > 0.1 - 1e-9
    force = np.zeros_like(mesh.points)
    force[tip, 2] = 0.15 / tip.sum()
    loads = clamped(mesh, mesh.points[:, 0] == 0.0).pull(force)
    return make_part(mesh, rubber(c1_pa=1e5, poisson_ratio=0.4), loads)


def bellow():
    """Three lobes, axisymmetric, drawn by 4 mm and blown by 20 kPa between clamped ends."""
    shape = Bellows(3, 6e-3, 3.6e-3, 11e-3, 4e-3, 1.2e-3, 1e-3)
    mesh = bellows_mesh("quad4", shape, across=4, along=(8, 10, 6, 4), lobes=1.0)
    z = mesh.points[:, 1]
    top = z > z.max() - 1e-9
    inner = np.arange(len(z)) < len(z) // 5  # of five rows of nodes, the first
    loads = clamped(mesh, z < 1e-9).hold(top, 0).hold(top, 1, 4e-3).press(mesh.faces_at(inner), 20e3)
    return make_part(mesh, load_material("dragonskin_30"), loads)


def pneunet(pressure=3e3):
    """Half of a finger of hex8 as thin as its walls, with two chambers and a channel."""
    counts, size = (20, 5, 8), (40e-3, 6.5e-3, 11e-3)
    whole = block("hex8", "solid", counts, size)
    x, y, z = (whole.points[whole.cells].mean(axis=1) / size * counts).T
    chambers = ((x > 2) & (x < 8)) | ((x > 10) & (x < 18))
    channel = (x > 2) & (x < 18) & (z > 2) & (z < 4)
    cells = whole.cells[~((y < 4) & ((chambers & (z > 2) & (z < 7)) | channel))]
    used, cells = np.unique(cells, return_inverse=True)
    mesh = make_mesh("hex8", "solid", whole.points[used], cells.reshape(-1, 8))
    points = mesh.points
    within = (points > 1e-9) & (points < np.array(size) - 1e-9)
    faces = mesh.boundary()
    inside = within[:, 0] & within[:, 2] & (points[:, 1] < size[1] - 1e-9)
    chosen = inside[faces].all(axis=1) & (points[faces].mean(axis=1)[:, 1] > 1e-9)
    loads = clamped(mesh, points[:, 0] == 0.0).hold(points[:, 1] == 0.0, 1)
    return make_part(mesh, load_material("dragonskin_10"), loads.press(faces[chosen], pressure))


def ring():
    """A quarter of a ring that is pushed by 2.5 mm against a plate."""
    mesh = tube("quad4", (6, 32), (6e-3, 9e-3))
    x, y = mesh.points.T
    plate = Obstacle(np.array([[0.03, 9e-3 + 2e-5], [-0.03, 9e-3 + 2e-5]]), np.array([[0, 1]]))
    loads = no_loads(mesh).hold(x == 0, 0).hold(y == 0, 1, 2.5e-3)
    return make_part(mesh, load_material("dragonskin_10"), loads, contact=Contact(1.5e-5, obstacles=(plate,)))


def sheared_block(n=10):
    """A block of n**3 hex8 of Yeoh's law, nearly incompressible, sheared by 150 % between plates."""
    mesh = block("hex8", "solid", (n, n, n), (1.0, 1.0, 1.0))
    z = mesh.points[:, 2]
    top = z == 1.0
    loads = clamped(mesh, z == 0.0).hold(top, 0, 1.5).hold(top, 1).hold(top, 2)
    return make_part(mesh, rubber(c1_pa=1.1e5, c2_pa=2e4, c3_pa=500.0, poisson_ratio=0.495), loads)


PARTS = {
    "tube": thick_tube,
    "beam": beam,
    "bellow": bellow,
    "pneunet": pneunet,
    "ring": ring,
    "block": sheared_block,
}


def values(name, part, state):
    """What the other library's figures are of."""
    points, u, reaction = part.mesh.points, state.u, state.reaction
    if name == "tube":
        x, y, z = points.T
        at = (y == 0) & (np.abs(np.hypot(x, y) - 4e-3) < 1e-8)
        return u[at, 0].mean(), reaction[z == 0, 2].sum()
    if name == "beam":
        return tuple(u[points[:, 0] > 0.1 - 1e-9].mean(axis=0)[[0, 2]])
    if name == "bellow":
        # It counts the pressure on held nodes with the other sign.
        other = reaction + 2.0 * part.push(u)
        return other[points[:, 1] > points[:, 1].max() - 1e-9, 1].sum(), u[:, 0].max()
    if name == "pneunet":
        return tuple(u[points[:, 0] > 40e-3 - 1e-9].mean(axis=0))
    if name == "ring":
        low = points[:, 1] == 0.0
        return reaction[low, 1].sum(), u[low, 0].mean()
    return tuple(reaction[points[:, 2] == 1.0].sum(axis=0)[[0, 2]])
