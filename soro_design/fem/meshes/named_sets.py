"""Named sets of nodes and elements of mesh files: of .inp and .msh, and whole numbers of .vtu."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

import numpy as np

from soro_core.arrays import Integers

# What a group of Gmsh without a name is called, with its number, by its dimension.
_GMSH = ("point", "line", "surface", "volume")
# A field with more values than these has numbers of nodes or elements, not of sets.
_MOST = 64


def named_sets(found: Any) -> dict[str, Integers]:
    """Return the nodes of the named sets of a mesh of meshio, by name.

    A physical group of .msh that has no name is `surface 3`, or `point`, `line` or `volume` and its number.
    A field of whole numbers of nodes or elements has those where it is not 0, under its name, and where it
    has several such values, those of each, as `zone 3`.
    """
    sets: dict[str, list[Any]] = {}

    def add(name: str, nodes: Any) -> None:
        sets.setdefault(name, []).append(np.ravel(nodes))

    for name, nodes in found.point_sets.items():
        add(name, nodes)
    for name, rows in found.cell_sets.items():
        if name in found.field_data or not name.startswith("gmsh:"):
            for block, own in zip(found.cells, rows, strict=False):
                add(name, block.data[own])
    names = {(int(dim), int(tag)): name for name, (tag, dim) in found.field_data.items()}
    for block, tags in zip(found.cells, found.cell_data.get("gmsh:physical", ()), strict=False):
        for tag in np.unique(tags[tags > 0]).tolist():
            name = names.get((block.dim, tag), f"{_GMSH[block.dim]} {tag}")
            add(name, block.data[tags == tag])
    for name, values, blocks in _fields(found):
        stated = [value for value in np.unique(np.concatenate(values)).tolist() if value != 0]
        if len(stated) <= _MOST:
            for value in stated:
                for block, of in zip(blocks, values, strict=True):
                    add(name, block[of == value])
                    if len(stated) > 1:
                        add(f"{name} {value}", block[of == value])
    return {name: np.unique(np.concatenate(nodes)).astype(np.int64) for name, nodes in sets.items()}


def inp_parts(text: str) -> tuple[str, dict[str, Integers]]:
    """Return the nodes and elements of an .inp file, as such a file, and its sets.

    Sets have nodes, counted from 0, by name; those of elements the nodes of these. Two sets of one name are
    one, as are the parts of a set that a file states in several places; where case differs, the first name
    stands. meshio keeps the last of such parts, and mistakes blocks of elements where not all have a set.

    Raises
    ------
    ValueError
        If a line has no numbers, or a set names what is not in the file.
    """
    index: dict[int, int] = {}
    elements: dict[int, list[int]] = {}
    sets: dict[tuple[str, str], list[int]] = {}  # of a kind, by name in capitals
    names: dict[str, str] = {}

    def add(kind: str, name: str, labels: Iterable[int]) -> None:
        names.setdefault(name.upper(), name)
        sets.setdefault((kind, name.upper()), []).extend(labels)

    rows: dict[str, list[str]] = {"NODE": ["*NODE"], "ELEMENT": []}
    kind, keys, pending = "", dict[str, str](), list[str]()
    for line in (each.strip() for each in text.splitlines()):
        if not line or line.startswith("**"):
            continue
        if line.startswith("*"):
            kind, *rest = (word.strip() for word in line[1:].split(","))
            kind, words = kind.upper(), (word.partition("=") for word in rest)
            keys = {key.strip().upper(): value.strip().strip('"') for key, _, value in words}
            if kind == "ELEMENT":
                rows[kind].append(f"*ELEMENT, TYPE={keys['TYPE']}")
            continue
        if kind not in (*rows, "NSET", "ELSET"):
            continue
        if kind in rows:
            rows[kind].append(line)
        pending += [word.strip() for word in line.split(",") if word.strip()]
        if kind == "ELEMENT" and line.endswith(","):  # goes on in the next line
            continue
        words_now, pending = pending, []
        if kind in rows:
            label = int(words_now[0])
            if kind == "NODE":
                index[label] = len(index)
            else:
                elements[label] = [int(word) for word in words_now[1:]]
            of = "NSET" if kind == "NODE" else "ELSET"
            if of in keys:
                add(of, keys[of], [label])
        elif "GENERATE" in keys:
            first, last, step = [*(int(word) for word in words_now), 1][:3]
            add(kind, keys[kind], range(first, last + 1, step))
        else:
            for word in words_now:
                other = sets.get((kind, word.upper()))
                add(kind, keys[kind], list(other) if other is not None else [int(word)])
    found: dict[str, Integers] = {}
    for (kind, name), labels in sets.items():
        missing = set(labels) - set(index if kind == "NSET" else elements)
        if missing:
            raise ValueError(f"set {names[name]} names {min(missing)}, which is not in the file")
        nodes = labels if kind == "NSET" else list(chain(*(elements[label] for label in labels)))
        own = np.unique([index[node] for node in nodes]).astype(np.int64)
        found[names[name]] = np.union1d(found.get(names[name], own), own)
    return "\n".join([*rows["NODE"], *rows["ELEMENT"]]) + "\n", found


def _fields(found: Any) -> Iterator[tuple[str, list[Any], list[Any]]]:
    """Fields of one whole number a node or element: name, values, and the nodes of each value."""
    points, cells = [np.arange(len(found.points))], [block.data for block in found.cells]
    for name, values, blocks in (
        *((name, [values], points) for name, values in found.point_data.items()),
        *((name, values, cells) for name, values in found.cell_data.items()),
    ):
        values = [np.asarray(one) for one in values]
        if not name.startswith("gmsh:") and all(one.ndim == 1 and one.dtype.kind in "iub" for one in values):
            yield name, values, blocks
