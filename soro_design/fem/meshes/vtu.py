"""VTU files of meshes and fields, for ParaView and whatever reads VTK."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soro_core.errors import ModelError
from soro_design.fem.elements.mesh import Mesh

_TYPES = {"f8": "Float64", "i8": "Int64", "u1": "UInt8"}


def write_vtu(
    path: str | Path,
    mesh: Mesh,
    at_nodes: Mapping[str, ArrayLike] | None = None,
    in_elements: Mapping[str, ArrayLike] | None = None,
) -> None:
    """Write a mesh with fields as an XML file of VTK; the arrays are base64, exact to the last bit.

    Parameters
    ----------
    path : str or Path
        File ending in .vtu, which is replaced.
    mesh : Mesh
        The undeformed mesh; a section lies in the plane z = 0.
    at_nodes : mapping of str to array_like, (n,) or (n, 2 or 3)
        Fields by name; vectors of a section get a third number 0.
    in_elements : mapping of str to array_like, (e,) or (e, 2 or 3)
        Fields of the elements.

    Raises
    ------
    ModelError
        If a field does not have a row for each node or element, or the file cannot be written.
    """
    n_nodes, (n_cells, n_each) = len(mesh.points), mesh.cells.shape
    types = np.full(n_cells, mesh.element.vtk)
    lines = [
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        "<UnstructuredGrid>",
        f'<Piece NumberOfPoints="{n_nodes}" NumberOfCells="{n_cells}">',
        "<PointData>",
        *(_field(name, values, n_nodes) for name, values in (at_nodes or {}).items()),
        "</PointData>",
        "<CellData>",
        *(_field(name, values, n_cells) for name, values in (in_elements or {}).items()),
        "</CellData>",
        "<Points>",
        _field("points", mesh.points, n_nodes),
        "</Points>",
        "<Cells>",
        _array("connectivity", mesh.cells.astype("<i8")),
        _array("offsets", np.arange(n_each, n_each * n_cells + 1, n_each).astype("<i8")),
        _array("types", types.astype("<u1")),
        "</Cells>",
        "</Piece>",
        "</UnstructuredGrid>",
        "</VTKFile>",
    ]
    _write(path, lines)


def write_pvd(path: str | Path, files: Mapping[float, str]) -> None:
    """Write a series of VTU files beside it, by time or load, for ParaView: a file that ends in .pvd.

    Raises
    ------
    ModelError
        If the file cannot be written.
    """
    rows = [f'<DataSet timestep="{at!r}" part="0" file={quoteattr(name)}/>' for at, name in files.items()]
    head = '<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">'
    _write(path, [head, "<Collection>", *rows, "</Collection>", "</VTKFile>"])


def _write(path: str | Path, lines: list[str]) -> None:
    try:
        Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise ModelError(
            f"path {path}: {error.strerror}; allowed: a file that can be written", "path"
        ) from None


def _field(name: str, values: ArrayLike, rows: int) -> str:
    found = np.asarray(values, dtype="<f8")
    if found.ndim not in (1, 2) or len(found) != rows:
        raise ModelError(f"field {name!r} of shape {found.shape}; allowed: {rows} rows", "field")
    if found.ndim == 2 and found.shape[1] == 2:
        found = np.concatenate([found, np.zeros((rows, 1))], axis=1)
    return _array(name, found)


def _array(name: str, values: NDArray[np.generic]) -> str:
    """A DataArray: the number of bytes and the bytes, in base64 each or together."""
    raw = values.tobytes()
    width = values.shape[1] if values.ndim == 2 and name != "connectivity" else 1
    text = base64.b64encode(len(raw).to_bytes(8, "little") + raw).decode()
    kind = _TYPES[values.dtype.str[1:]]
    attributes = f'type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}" format="binary"'
    return f"<DataArray {attributes}>{text}</DataArray>"
