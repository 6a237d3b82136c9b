"""Bellows of the three-bellow part of the thesis, with its forces; for tests, benchmarks and pictures."""

import numpy as np

from soro_design.fem.elements.material import material_from_dict
from soro_design.fem.loads import no_loads
from soro_design.fem.meshes.bellows import Bellows, bellows_mesh
from soro_design.fem.part import make_part
from soro_design.fem.solve.newton import solve

LENGTH = 64e-3  # of the part [m]
PITCH = 6.975e-3
LOBES = 8
# Where the outline ends is not given. The part is longer than its lobes: each end is a tube, wide as a neck.
SHAPE = Bellows(
    lobes=LOBES,
    pitch=PITCH,
    lobe_width=4.3e-3,
    outer_radius=12.6e-3,
    neck_radius=3.6e-3,
    fillet=1.1e-3,
    wall=0.8e-3,
    end=0.5 * (LENGTH - LOBES * PITCH),
)
MATERIAL = material_from_dict(
    {
        "kind": "st_venant_kirchhoff",
        "source": "three-bellow part of the thesis",
        "youngs_modulus_pa": 80e6,
        "poisson_ratio": 0.4,
    }
)
# Extension [mm] and force of three bellows in parallel [N] of the thesis.
THESIS = {
    3.5: 1.7895,
    5.5: 2.9289,
    7.1: 3.9445,
    8.7: 5.0759,
    11.0: 6.8505,
    12.4: 8.1245,
    13.8: 9.5167,
    15.2: 11.0292,
    16.8: 12.9051,
    18.4: 14.9354,
    20.0: 17.1146,
}
ALONG = (8, 8, 5, 4)


def forces(shape=SHAPE, is_clamped=True, lobes=0.5 * LOBES, across=3, along=ALONG):
    """Force of three bellows [N] by extension, from one end with some lobes, up to a plane of symmetry."""
    mesh = bellows_mesh("quad8", shape, across, along, lobes=lobes)
    z = mesh.points[:, 1]
    end, middle = z < 1e-9, z > z.max() - 1e-9
    loads = no_loads(mesh).hold(end, 1, -20e-3 * lobes / shape.lobes).hold(middle, 1)
    if is_clamped:
        loads = loads.hold(end, 0)
    done = solve(make_part(mesh, MATERIAL, loads), [x / 20.0 for x in THESIS])
    assert done.status == "solved", done.cause
    return np.array([-3.0 * state.reaction[end, 1].sum() for state in done.states])
