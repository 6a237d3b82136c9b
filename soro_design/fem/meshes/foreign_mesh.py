"""Meshes of other programs by what is in their files: meshio goes by the ending of the name alone."""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from soro_core.arrays import Integers
from soro_core.errors import ModelError, short
from soro_core.extras import named_packages
from soro_design.fem.meshes.named_sets import inp_parts

# How files begin, or what stands at the beginning of a line near there, and meshio's name of the format.
_FORMATS = (
    (rb"^\$(MeshFormat|NOD)\b", "gmsh"),
    (rb"\A# vtk DataFile", "vtk"),
    (rb"<VTKFile[^>]*UnstructuredGrid", "vtu"),
    (rb"<Xdmf", "xdmf"),
    (rb"<dolfin", "dolfin-xml"),
    (rb"^\s*MeshVersionFormatted", "medit"),
    (rb"(?i)^\*(heading|node|part)\b", "abaqus"),
    (rb"^NDIME\s*=", "su2"),
    (rb"\A(#.*\n)*OFF\b", "off"),
    (rb"\Aply\b", "ply"),
    (rb"\Amesh3d\b", "netgen"),
    (rb"(?i)^(begin bulk|grid[ ,*])", "nastran"),
    (rb"\Asolid\b", "stl"),
    (rb"^v\s+[-+0-9.eE]+\s+[-+0-9.eE]+\s", "obj"),
)
_NO_MESHES = (
    (rb"(?i)^mesh\b.*\belemtype\b", "a mesh of GiD, to be saved as .vtk or .inp first"),
    (rb"<VTKFile", "a VTK file of another kind than UnstructuredGrid"),
    (rb"\AISO-10303-21", "a STEP file, whose name ends in .step or .stp"),
    (rb"\APK\x03\x04|\A\x1f\x8b|\A7z", "an archive, to be unpacked first"),
    (rb"\Aversion https://git-lfs", "a pointer of git-lfs in place of the file: git lfs pull"),
    (rb"(?i)\A(<!doctype )?html|\A<html", "a web page"),
)
_HEAD = 8192
_INCLUDE = re.compile(r"(?mi)^[ \t]*\*include[ \t]*,[ \t]*input[ \t]*=(.*)$")
_GMSH_1 = re.compile(rb"(?m)^\$NOD\b")
_COMMENT = re.compile(rb"(?m)^[ \t]*(//|#).*\n")
# Of VTU files since VTK 9, which differ in kinds of elements that are not read here.
_VERSION = re.compile(rb"""(<VTKFile[^>]*\bversion=["'])2\.\d+""")


def read_foreign(path: Path) -> Any:
    """Return the mesh of meshio of a file, in the format of its content, else in that of its ending.

    Comment lines of a text file of Gmsh are skipped. Faces of .obj may count their points from the last one.
    VTU files of the versions 2 are read as those of version 1, and files of Gmsh 1.

    Raises
    ------
    ModelError
        If the file cannot be read: what it is, and the cause.
    MissingPackageError
        If meshio is not installed.
    """
    with named_packages():
        import meshio
    if not path.is_file():
        raise ModelError(f"path {path}: no such file; allowed: a mesh", "path")
    with path.open("rb") as file:
        head = file.read(_HEAD).removeprefix(b"\xef\xbb\xbf").lstrip()
    if not head:
        raise _refused(path, "an empty file")
    form = next((name for sign, name in _FORMATS if re.search(sign, head, re.MULTILINE)), None)
    if form is None and path.suffix.lower() == ".inp":
        form = "abaqus"
    words = next((words for sign, words in _NO_MESHES if re.search(sign, head, re.MULTILINE)), None)
    if form is None and words is not None:
        raise _refused(path, words)
    if form is None and path.suffix.lower() not in meshio.extension_to_filetypes:
        raise _refused(path, f"no mesh that is known by its content, nor by the ending {path.suffix!r}")
    data = path.read_bytes().removeprefix(b"\xef\xbb\xbf") if form in ("gmsh", "obj", "stl", "vtu") else b""
    if form == "gmsh" and _GMSH_1.search(data):
        data = _of_gmsh_1(data)
    if form == "gmsh" and not (b"$EndNodes" in data and b"$EndElements" in data):
        raise _refused(path, "by its content gmsh, and damaged: $EndNodes or $EndElements is missing")
    if form == "stl":
        _check_facets(path, data)
    sets = None
    with tempfile.TemporaryDirectory(prefix="soro-") as folder:
        plain = path
        if form == "gmsh" and re.search(rb"\$MeshFormat\s+\S+\s+0\s", data):
            plain = Path(folder) / "plain.msh"
            plain.write_bytes(_COMMENT.sub(b"", data))
        if form == "obj":
            plain = Path(folder) / "plain.obj"
            plain.write_bytes(_plain_obj(path, data))
        if form == "vtu" and _VERSION.search(data):
            plain = Path(folder) / "plain.vtu"
            plain.write_bytes(_VERSION.sub(rb"\g<1>1.0", data, count=1))
        if form == "abaqus":
            plain = Path(folder) / "plain.inp"
            text, sets = _plain_inp(path)
            plain.write_text(text, encoding="utf-8")
        said = io.StringIO()
        try:
            with (
                contextlib.redirect_stdout(said),
                contextlib.redirect_stderr(io.StringIO()),
                warnings.catch_warnings(action="ignore"),  # an overflow where meshio judges any STL in text
            ):
                found = meshio.read(plain, form)
        # meshio prints the cause and ends the process where it cannot read a format.
        except (Exception, SystemExit) as error:
            cause = said.getvalue() if isinstance(error, SystemExit) else f"{type(error).__name__} {error}"
            text = " ".join(cause.replace(str(plain), path.name).split()) or "unreadable"
            begins = f"by its content {form}" if form else f"by its ending {path.suffix}"
            raise _refused(path, f"{begins}, and damaged: {text}") from None
    if sets is not None:
        found.point_sets = sets
    if not np.isfinite(found.points).all():
        raise _refused(path, "points that are not finite")
    for block in found.cells:
        if len(block.data) and isinstance(block.data, np.ndarray):
            low, high = int(block.data.min()), int(block.data.max())
            if low < 0 or high >= len(found.points):
                raise _refused(
                    path, f"an element of point {high if low >= 0 else low} of {len(found.points)}"
                )
    return found


def _of_gmsh_1(data: bytes) -> bytes:
    """Return a file of Gmsh 1 as of 2.2: elements count their tags there, and here their nodes."""
    nodes, _, rest = data.partition(b"$ELM")
    elements, end, _ = rest.partition(b"$ENDELM")
    rows = [line.split() for line in elements.splitlines() if line.strip()]
    rows = [row if len(row) < 5 else [*row[:2], b"2", *row[2:4], *row[5:]] for row in rows]
    nodes = nodes.replace(b"$NOD", b"$Nodes").replace(b"$ENDNOD", b"$EndNodes")
    lines = [b"$MeshFormat\n2.2 0 8\n$EndMeshFormat", nodes.strip(), b"$Elements", *map(b" ".join, rows)]
    return b"\n".join([*lines, b"$EndElements\n" if end else b""])


def _plain_obj(path: Path, data: bytes) -> bytes:
    """Return an .obj as meshio reads it: points with three numbers, and faces that count them from 1."""
    lines, points, most = [], 0, 0
    for line in re.sub(rb"\\\r?\n", b" ", data).splitlines():
        kind, *rest = line.split() or [b""]
        if kind == b"v":  # a colour or a weight may follow
            points += 1
            lines.append(b" ".join([b"v", *rest[:3]]))
        elif kind == b"f":
            face = line.decode(errors="replace")
            try:
                stated = [int(corner.partition(b"/")[0]) for corner in rest]
            except ValueError:
                raise _refused(path, f"by its content obj, and damaged: face {short(face)}") from None
            corners = [n if n > 0 else points + 1 + n for n in stated]
            if 0 in stated or min(corners, default=1) < 1:
                raise _refused(
                    path, f"face {short(face)} names a point that is not among the {points} before it"
                )
            most = max([most, *corners])
            lines.append(b"f " + b" ".join(b"%d" % n for n in corners))
    if most > points:
        raise _refused(path, f"a face of point {most} of {points}")
    return b"\n".join(lines) + b"\n"


def _plain_inp(path: Path) -> tuple[str, dict[str, Integers]]:
    """Return `inp_parts` of a file and of those that it includes."""

    def included(match: re.Match[str]) -> str:
        return (path.parent / match[1].strip()).read_text(encoding="utf-8", errors="replace")

    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
        return inp_parts(_INCLUDE.sub(included, text))
    except OSError as error:
        raise _refused(path, f"a file that it includes: {error.strerror}") from None
    except (ValueError, KeyError, IndexError) as error:
        raise _refused(path, f"by its content abaqus, and damaged: {error}") from None


def _check_facets(path: Path, data: bytes) -> None:
    """Refuse an STL file in text whose facets are no triangles: meshio would take other points together."""
    if len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return  # in bytes, in spite of how it begins
    for k, loop in enumerate(re.finditer(rb"(?is)outer\s+loop(.*?)endloop", data)):
        count = len(re.findall(rb"(?i)\bvertex\b", loop[1]))
        if count != 3:
            raise _refused(path, f"facet {k} of {count} points, where STL has triangles alone")


def _refused(path: Path, got: str) -> ModelError:
    return ModelError(f"path {path}: {got}; allowed: a mesh that meshio reads", "path")
