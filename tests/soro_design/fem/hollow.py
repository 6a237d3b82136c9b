"""Meshes with closed surfaces inside, for tests: blocks without the elements of some boxes."""

import numpy as np

from soro_design.fem.elements.mesh import make_mesh
from soro_design.fem.meshes.blocks import block

# A block of 60 x 40 x 40 mm with two cavities of 4,000 and 8,000 mm3, as boxes (least, greatest) in mm.
SIZE, COUNTS = (60, 40, 40), (6, 4, 4)
CAVITIES = (((10, 10, 10), (20, 30, 30)), ((30, 10, 10), (50, 30, 30)))
# Three chambers, joined by a channel at the bottom, with slots from above between them.
NET_SIZE, NET_COUNTS = (110, 30, 50), (11, 3, 5)
NET_AIR = (*(((x, 10, 10), (x + 10, 20, 40)) for x in (10, 50, 90)), ((10, 10, 10), (100, 20, 20)))
NET_SLOTS = tuple(((x, 0, 30), (x + 10, 30, 50)) for x in (30, 70))


def without(kind, size, counts, boxes):
    """A block [m] of a kind of element less those whose middles lie in boxes."""
    d = len(size)
    mesh = block(kind, "solid" if d == 3 else "plane_strain", counts, tuple(1e-3 * s for s in size))
    corners = mesh.cells[:, : {"tet10": 4, "hex8": 8, "hex20": 8, "quad4": 4}[kind]]
    middle = 1e3 * mesh.points[corners].mean(axis=1)
    is_air = np.zeros(len(middle), dtype=bool)
    for low, high in boxes:
        is_air |= ((middle > low) & (middle < high)).all(axis=1)
    used, cells = np.unique(mesh.cells[~is_air], return_inverse=True)
    return make_mesh(kind, mesh.space, mesh.points[used], cells.reshape(-1, mesh.cells.shape[1]))
