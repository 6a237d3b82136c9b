"""Files of tetrahedra as public examples have them, for tests."""

from itertools import combinations

import numpy as np

from tests.soro_design.fem.hollow import NET_AIR, NET_COUNTS, NET_SIZE, NET_SLOTS, without

# Of three chambers and their channel [m3].
NET_VOLUME = 15e-6
# Six tetrahedra of a hexahedron.
PATHS = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]


def net_of_tetrahedra():
    """Points [mm] and tetrahedra of three chambers, joined by a channel."""
    net = without("hex8", NET_SIZE, NET_COUNTS, (*NET_AIR, *NET_SLOTS))
    return 1e3 * net.points, np.concatenate([net.cells[:, one] for one in PATHS])


def gmsh_vtk(points, tetrahedra):
    """Text of a legacy VTK file as of Gmsh: points, lines and triangles of the surface are cells too."""
    faces = np.sort(np.concatenate([tetrahedra[:, one] for one in combinations(range(4), 3)]), axis=1)
    faces, count = np.unique(faces, axis=0, return_counts=True)
    faces = faces[count == 1]
    lines = np.unique(np.concatenate([faces[:, one] for one in combinations(range(3), 2)]), axis=0)
    blocks = {1: np.arange(8)[:, None], 3: lines, 5: faces, 10: tetrahedra}
    cells = [[cell.size, *cell.tolist()] for block in blocks.values() for cell in block]
    rows = [
        "# vtk DataFile Version 2.0\nnet, Created by Gmsh\nASCII\nDATASET UNSTRUCTURED_GRID",
        f"POINTS {len(points)} double",
        *(" ".join(f"{x:.16g}" for x in point) for point in points),
        f"\nCELLS {len(cells)} {sum(map(len, cells))}",
        *(" ".join(map(str, cell)) for cell in cells),
        f"\nCELL_TYPES {len(cells)}",
        *(str(kind) for kind, block in blocks.items() for _ in block),
    ]
    return "\n".join(rows) + "\n"


def sofa_vtu(points, tetrahedra, version="0.1"):
    """Text of a VTU file in text, in the other byte order, of single precision, points without a name."""

    def array(attributes, rows):
        lines = "".join(f"          {' '.join(map(str, row))} \n" for row in rows)
        return f'        <DataArray {attributes} format="ascii">\n{lines}        </DataArray>\n'

    return (
        f'<VTKFile type="UnstructuredGrid" version="{version}" byte_order="BigEndian">\n'
        "  <UnstructuredGrid>\n"
        f'    <Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(tetrahedra)}">\n      <Points>\n'
        + array('type="Float32" NumberOfComponents="3"', [[f"{x:g}" for x in point] for point in points])
        + "      </Points>\n      <Cells>\n"
        + array('type="Int32" Name="connectivity"', tetrahedra)
        + array('type="Int32" Name="offsets"', [range(4, 4 * len(tetrahedra) + 1, 4)])
        + array('type="UInt8" Name="types"', [[10] * len(tetrahedra)])
        + "      </Cells>\n    </Piece>\n  </UnstructuredGrid>\n</VTKFile>\n"
    )
