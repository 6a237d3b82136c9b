"""Part files with a mesh, tendons or contact that are refused: one line that names the key."""

import pytest

from soro_design.parts.file import load_part
from soro_design.parts.specimen import make_specimen
from tests.refused import refused
from tests.soro_design.fem.mesh_parts import BEAM_MESH, BEAM_PART, BLOWN, PULL, TUBE_MESH, TUBE_PART, meshes
from tests.soro_design.fem.small_parts import written

ALONG = [[0.01, 0.005, 0.0], [0.01, 0.005, 0.04]]
PLANE = {"through_m": [0.0, 0.0, -1e-3], "normal": [0.0, 0.0, 1.0], "size_m": 0.1}
NARROW = {"z_m": [0.01, 0.03], "x_m": [0.004, 0.006]}


def check(tmp_path, part, key, names, **changes):
    meshes(tmp_path)
    with refused(key, names=names):
        make_specimen(load_part(written(tmp_path, part, **changes)))


@pytest.mark.parametrize(
    ("changes", "key", "names"),
    [
        ({"file": "none.vtu"}, "file", ()),
        ({"file": "part.yaml"}, "file", ()),
        ({"space": "cube"}, "space", ("axisymmetric",)),
        ({"unit_m": 0.0}, "unit_m", ()),
        ({"regions": {}}, "held[0].region", ()),
        ({"held": [{"region": "base", "directions": "z"}]}, "held[0].directions", ("x and y",)),
        ({"held": [{"region": "foot", "directions": "y"}]}, "held[0].region", ("base",)),
        ({"held": []}, "pressed[0]", ("is_open", "open at (")),
        ({"pressed": [{"region": "roof"}]}, "pressed[0].region", ("inside",)),
        ({"pressed": [{"region": "base", "is_open": 1}]}, "pressed[0].is_open", ()),
        ({"moved": {"region": "top", "direction": "q"}}, "moved.direction", ()),
        ({"forced": "roof"}, "forced", ("top",)),
    ],
)
def test_what_acts_on_a_mesh(tmp_path, changes, key, names):
    check(tmp_path, TUBE_PART, f"geometry.{key}", names, geometry={**TUBE_MESH, **changes})


@pytest.mark.parametrize(
    ("top", "key", "names"),
    [
        ({}, "", ("group", "x_m")),
        ({"y_m": [1.0, 0.0]}, "", ("y_m",)),
        ({"y_m": [1.0, 2.0]}, "", ("0.02",)),
        ({"z_m": [0.0, 1.0]}, ".z_m", ("x and y",)),
        ({"radius_m": [0.0, 1.0]}, ".radius_m", ("x and y",)),
        ({"group": "g"}, ".group", ("bounds",)),
    ],
)
def test_regions(tmp_path, top, key, names):
    geometry = {**TUBE_MESH, "regions": {**TUBE_MESH["regions"], "top": top}}
    check(tmp_path, TUBE_PART, f"geometry.regions.top{key}", names, geometry=geometry)


@pytest.mark.parametrize(
    ("changes", "key", "names"),
    [
        ({"file": "tube.vtu"}, "file", ("hexahedron",)),
        ({"file": "part.step"}, "largest_m", ()),
        ({"file": "part.stl"}, "largest_m", ("STL",)),
        ({"file": "part.step", "largest_m": 1e-3, "space": "axisymmetric"}, "space", ("solid",)),
        ({"pressed": [{"region": "side"}]}, "pressed[0]", ("is_open",)),
        ({"regions": {**BEAM_MESH["regions"], "end": NARROW}}, "forced", ("face",)),
    ],
)
def test_solids(tmp_path, changes, key, names):
    for ending in ("step", "stl"):
        (tmp_path / f"part.{ending}").write_text("no solid")
    check(tmp_path, BEAM_PART, f"geometry.{key}", names, geometry={**BEAM_MESH, **changes})


@pytest.mark.parametrize(
    ("part", "sweep", "key", "names"),
    [
        (TUBE_PART, PULL, "force_n", ("forced",)),
        (BEAM_PART, BLOWN, "pressures_pa", ()),
        (BEAM_PART, {"name": "a", "extension_m": 1e-3}, "extension_m", ("geometry.moved",)),
        (BEAM_PART, {"name": "a", "tensions_n": [0.01]}, "tensions_n", ()),
    ],
)
def test_loads_that_a_part_does_not_take(tmp_path, part, sweep, key, names):
    check(tmp_path, part, f"sweeps[0].{key}", names, sweeps=[sweep])


@pytest.mark.parametrize(
    ("tendon", "key", "names"),
    [
        ({"along_m": ALONG[:1]}, "along_m", ()),
        ({"along_m": ALONG, "stiffness_n": -1.0}, "stiffness_n", ()),
        ({"along_m": [*ALONG, [0.1, 0.0, 0.0]]}, "along_m", ("in the part",)),
        ({"along_m": [*ALONG, ALONG[1]]}, "along_m", ()),
    ],
)
def test_tendons(tmp_path, tendon, key, names):
    check(tmp_path, BEAM_PART, f"tendons[0].{key}", names, tendons=[tendon])


def test_a_section_has_no_tendons(tmp_path):
    check(tmp_path, TUBE_PART, "tendons", ("solid",), tendons=[{"along_m": ALONG}])


@pytest.mark.parametrize(
    ("part", "changes", "key", "names"),
    [
        (BEAM_PART, {"distance_m": 0.0}, "distance_m", ()),
        (BEAM_PART, {"distance_m": 1e-2}, "distance_m", ("0.00312 m",)),
        (BEAM_PART, {"stiffness_pa": 0.0}, "stiffness_pa", ()),
        (BEAM_PART, {"planes": [{**PLANE, "normal": [0.0, 0.0, 0.0]}]}, "planes[0].normal", ()),
        (BEAM_PART, {"planes": [{**PLANE, "size_m": -1.0}]}, "planes[0].size_m", ()),
        (TUBE_PART, {"planes": [PLANE]}, "planes[0].through_m", ("2 numbers",)),
    ],
)
def test_contact(tmp_path, part, changes, key, names):
    pytest.importorskip("ipctk", reason="needs the extra design: pip install 'soro[design]'")
    check(tmp_path, part, f"contact.{key}", names, contact={"distance_m": 1e-4, **changes})
