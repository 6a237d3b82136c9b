"""Part files with a mesh of their own: as a kind of ours, groups, STEP, tendons, contact."""

import sys
import xml.etree.ElementTree as ET
from importlib.util import find_spec

import numpy as np
import pytest
from typer.testing import CliRunner

from soro_core.extras import MissingPackageError
from soro_core.files.stl import read_stl, write_stl
from soro_design.fem import EquilibriumState
from soro_design.fem.meshes.mesh_files import read_mesh
from soro_design.fem.meshes.surface import pieces, solid_surface, volume
from soro_design.parts.file import load_part, material_of
from soro_design.parts.picture import obstacle_lines
from soro_design.parts.specimen import make_specimen
from soro_design.parts.step import write_step
from soro_design.parts.sweeps import follow
from soro_design.parts.tendons import route
from soro_ros.cli import application
from tests.refused import fails, refused
from tests.soro_design.fem.hollow import CAVITIES, COUNTS, SIZE, without
from tests.soro_design.fem.mesh_parts import BEAM_MESH, BEAM_PART, BLOWN, TUBE_PART, meshes
from tests.soro_design.fem.small_parts import ROD, TUBE, written
from tests.soro_design.fem.test_fem_mesh_files import MSH

# Young's modulus of dragonskin_10, nearly: six c1.
E = 6.0 * 36e3


@pytest.fixture(autouse=True)
def _with_meshes(tmp_path):
    meshes(tmp_path)


def last(tmp_path, part, **changes) -> tuple[object, EquilibriumState]:
    """The specimen and the end of its first sweep."""
    file = load_part(written(tmp_path, part, **changes))
    specimen = make_specimen(file)
    done = follow(specimen, file.sweeps[0], lambda state: None)
    assert done.status == "solved", done.cause
    return specimen, done.last


def test_a_tube_of_a_file_moves_as_the_tube_of_its_kind(tmp_path):
    sweep = {"name": "both", "pressures_pa": [5e3], "extension_m": 2e-3, "states": 2}
    own, state = last(tmp_path, TUBE_PART, sweeps=[sweep])
    kind, expected = last(tmp_path, TUBE, sweeps=[sweep])
    np.testing.assert_allclose(state.u, expected.u, atol=1e-12)
    found, known = own.measured(state), kind.measured(expected)
    assert found["reaction_n"] == pytest.approx(known["force_n"])
    assert found["mean_y_m"] == pytest.approx(2e-3)


def test_a_force_is_shared_by_its_faces(tmp_path):
    specimen, state = last(tmp_path, BEAM_PART)
    base = state.reaction.sum(axis=0)
    np.testing.assert_allclose(base, [0.0, 0.0, -0.1], atol=1e-9)
    stretch = specimen.measured(state)["mean_z_m"] / 0.04
    # The clamp keeps the foot from narrowing.
    assert stretch == pytest.approx(0.1 / (E * 1e-4), rel=0.05)


def test_groups_and_units_of_a_gmsh_file(tmp_path):
    (tmp_path / "square.msh").write_text(MSH)
    geometry = {
        "kind": "mesh", "file": "square.msh", "space": "plane_strain", "unit_m": 1e-3,
        "regions": {
            "left": {"group": "held"}, "corner": {"group": "held", "y_m": [0, 0]},
            "right": {"x_m": [1e-3, 1e-3]},
        },
        "held": [{"region": "left", "directions": "x"}, {"region": "corner", "directions": "y"}],
        "forced": "right",
    }  # fmt: skip
    sweep = {"name": "pull", "force_n": [0.1, 0.0, 0.0], "states": 1}
    specimen, state = last(tmp_path, {"geometry": geometry, "material": "dragonskin_10", "sweeps": [sweep]})
    # Plane strain of nearly incompressible rubber: 4/3 E.
    assert specimen.measured(state)["mean_x_m"] == pytest.approx(1e-3 * 100.0 / (4.0 / 3.0 * E), rel=0.03)


def test_a_step_file_becomes_a_part(tmp_path):
    """A tube as a solid, written as STEP, pulled: EA of its ring."""
    pytest.importorskip("netgen.occ", reason="needs the extra mesh: pip install 'soro[mesh]'")
    write_step(tmp_path / "tube.step", load_part(written(tmp_path, TUBE)).geometry)
    geometry = {
        **BEAM_MESH, "file": "tube.step", "largest_m": 8e-3,
        "regions": {
            "base": {"z_m": [0.0, 0.0]}, "end": {"z_m": [0.02, 0.02]}, "inside": {"radius_m": [0.0, 0.00401]},
        },
        "held": [{"region": "base", "directions": "z"}, {"region": "inside", "directions": "xy"}],
    }  # fmt: skip
    specimen, state = last(tmp_path, BEAM_PART, geometry=geometry)
    assert specimen.part.mesh.kind == "tet10"
    strain = specimen.measured(state)["mean_z_m"] / 0.02
    # Held at its inner radius it is stiffer than free, by less than 4/3 of plane strain.
    free = 0.1 / (E * np.pi * (0.008**2 - 0.004**2))
    assert 0.75 * free < strain < free


def test_an_stl_file_becomes_a_part_with_its_cavities(tmp_path, monkeypatch):
    """Meshed where netgen is installed, else refused with the command that installs it."""
    path = tmp_path / "hollow.stl"
    write_stl(path, *solid_surface(without("hex8", SIZE, COUNTS, CAVITIES)))
    geometry = {
        **BEAM_MESH, "file": "hollow.stl", "largest_m": 12e-3, "unit_m": 1e-3,
        "regions": {"base": {"x_m": [0.0, 0.0]}, "end": {"x_m": [0.06, 0.06]}, "air": {"inner_surface": 2}},
        "pressed": [{"region": "air"}],
    }  # fmt: skip
    if find_spec("netgen"):
        specimen, state = last(tmp_path, BEAM_PART, geometry=geometry, sweeps=[BLOWN])
        faces, _ = specimen.pressed[0]
        assert volume(specimen.part.mesh.points, pieces(faces)) == pytest.approx(-4e-6, rel=1e-6)
        assert specimen.measured(state)["farthest_m"] > 1e-5
    for name in ("netgen", "netgen.stl"):
        monkeypatch.setitem(sys.modules, name, None)
    with fails(MissingPackageError, "pip install 'soro[mesh]'"):
        make_specimen(load_part(written(tmp_path, BEAM_PART, geometry=geometry, sweeps=[BLOWN])))


def test_a_tendon_beside_the_axis_bends_a_beam(tmp_path, figure):
    """Its tension T at a distance e is a moment: the end moves by T e L^2 / (2 EI) towards it."""
    tendon = {"along_m": [[0.01, 0.005, 0.0], [0.01, 0.005, 0.04]]}
    sweep = {"name": "bent", "tensions_n": [0.01], "states": 1}
    specimen, state = last(tmp_path, BEAM_PART, tendons=[tendon], sweeps=[sweep])
    expected = 0.01 * 0.005 * 0.04**2 / (2.0 * E * 0.01**4 / 12.0)
    found = specimen.measured(state)["mean_x_m"]
    figure(f"beam with a tendon: deflection {found / expected - 1:+.1%} off its moment's")
    assert found == pytest.approx(expected, rel=0.05)
    # One that is fixed along its way has stiffness: it holds the beam against a pull.
    middle = {"along_m": [[0.005, 0.005, 0.0], [0.005, 0.005, 0.04]]}
    means = []
    for stiffness in (0.0, 1e3):
        specimen, state = last(tmp_path, BEAM_PART, tendons=[{**middle, "stiffness_n": stiffness}])
        means.append(specimen.measured(state)["mean_z_m"])
    assert means[1] < 0.5 * means[0]


@pytest.mark.slow
def test_a_rod_with_a_tendon_bends_towards_it(tmp_path):
    """Between the first two chambers, and its tension stands in the table."""
    at = 0.0105 * np.array([np.cos(np.pi / 3.0), np.sin(np.pi / 3.0)])
    tendon = {"along_m": [[*map(float, at), 0.0], [*map(float, at), 0.06]]}
    sweep = {"name": "bent", "tensions_n": [0.2], "states": 1}
    path = written(tmp_path, ROD, tendons=[tendon], sweeps=[sweep])
    done = CliRunner().invoke(application(), ["fem", "run", str(path), "--out", str(tmp_path / "run")])
    assert done.exit_code == 0, done.output
    head, row = (tmp_path / "run" / "table.csv").read_text().splitlines()
    named = dict(zip(head.split(","), row.split(","), strict=True))
    assert float(named["tension_0_n"]) == 0.2
    side = np.array([float(named["tip_x_m"]), float(named["tip_y_m"])])
    assert side @ at / np.linalg.norm(at) > 1e-3
    assert abs(np.cross([*side, 0.0], [*at, 0.0])[2]) < 0.05 * np.linalg.norm(side) * np.linalg.norm(at)


def test_a_link_has_neither_contact_nor_tendons(tmp_path):
    tendon = {"along_m": [[0.01, 0.0, 0.0], [0.01, 0.0, 0.06]]}
    sweep = {"name": "bent", "tensions_n": [0.2]}
    for changes, key in (
        ({"contact": {"distance_m": 1e-4}}, "contact"),
        ({"tendons": [tendon], "sweeps": [sweep]}, "sweeps.bent.tensions_n"),
    ):
        path = written(tmp_path, ROD, **changes)
        call = ["identify-fem", str(path), "--out", str(tmp_path / "arm.yaml")]
        with refused(key):
            raise CliRunner().invoke(application(), call).exception


def test_a_mesh_has_no_exact_solid_to_export(tmp_path):
    path, beam = written(tmp_path, BEAM_PART), str(tmp_path / "beam")
    call = ["design", "export", str(path)]
    with refused("geometry.kind"):
        raise CliRunner().invoke(application(), [*call, "--step", f"{beam}.step"]).exception
    done = CliRunner().invoke(application(), [*call, "--stl", f"{beam}.stl"])
    assert done.exit_code == 0, done.output
    assert volume(*read_stl(f"{beam}.stl")) == pytest.approx(4e-6, rel=1e-6)


def test_a_tendon_runs_through_neighbours_near_its_line(tmp_path):
    mesh = read_mesh(tmp_path / "beam.vtu", "solid").mesh
    pieces = route(mesh, [(0.0, 0.0, 0.0), (0.01, 0.0, 0.02), (0.01, 0.01, 0.04)])
    assert (pieces[1:, 0] == pieces[:-1, 1]).all()
    ends = mesh.points[[pieces[0, 0], pieces[-1, 1]]]
    np.testing.assert_allclose(ends, [[0.0, 0.0, 0.0], [0.01, 0.01, 0.04]], atol=1e-12)
    assert (np.abs(mesh.points[pieces[:, 0]] - [0.01, 0.0, 0.02]).max(axis=1) < 1e-12).sum() == 1
    # Elements are 5 x 5 x 4 mm: no node of the chain is farther than half of one from its line.
    x, y, z = mesh.points[np.unique(pieces)].T
    off = np.where(z < 0.02, np.hypot(x - 0.5 * z, y), np.hypot(x - 0.01, y - 0.5 * (z - 0.02)))
    assert off.max() <= 2.5e-3


def test_a_part_stops_at_a_plane(tmp_path, figure):
    """A beam pushed down by 2 mm onto a floor 1 mm below: squeezed by what is left."""
    pytest.importorskip("ipctk", reason="needs the extra design: pip install 'soro[design]'")
    geometry = {
        **{key: value for key, value in BEAM_MESH.items() if key != "forced"},
        "held": [{"region": "end", "directions": "xy"}],
        "moved": {"region": "end", "direction": "z"},
    }
    contact = {
        "distance_m": 1e-4,
        "planes": [{"through_m": [0.005, 0.005, -1e-3], "normal": [0.0, 0.0, 1.0], "size_m": 0.1}],
    }
    sweep = {"name": "down", "extension_m": -2e-3, "states": 4}
    specimen, state = last(tmp_path, BEAM_PART, geometry=geometry, contact=contact, sweeps=[sweep])
    foot = specimen.part.mesh.points[:, 2] == 0.0
    gap = 1e-3 + state.u[foot, 2]
    assert gap.min() > 0.0
    assert gap.max() < 1e-4
    strain = (2e-3 - 1e-3 + gap.mean()) / 0.04
    force = -specimen.measured(state)["reaction_n"]
    figure(f"beam on a floor: gap {1e6 * gap.mean():.0f} um, {force / (E * 1e-4 * strain):.3f} of EA strain")
    assert force == pytest.approx(E * 1e-4 * strain, rel=0.08)


def test_a_picture_shows_the_obstacles_of_a_section():
    pytest.importorskip("ipctk", reason="needs the extra design: pip install 'soro[design]'")
    (line,) = obstacle_lines(make_specimen(load_part("finger_over_table")))
    assert np.sort(line, axis=0) == pytest.approx(np.array([[-0.035, -0.01], [0.085, -0.01]]))


@pytest.mark.parametrize("part", [TUBE_PART, BEAM_PART], ids=["section", "solid"])
def test_a_run_of_a_mesh_leaves_a_table_and_pictures(tmp_path, part):
    path = written(tmp_path, part)
    done = CliRunner().invoke(application(), ["fem", "run", str(path), "--out", str(tmp_path / "run")])
    assert done.exit_code == 0, done.output
    for name in ("shapes.png", "curves.png"):
        assert (tmp_path / "run" / name).stat().st_size > 1000
    for field in ("displacement", "von_mises_pa", "stretch"):
        assert f'Name="{field}"' in next((tmp_path / "run").glob("*.vtu")).read_text()
    (series,) = (tmp_path / "run").glob("*.pvd")
    (state,) = ET.parse(series).getroot().find("Collection")
    assert float(state.get("timestep")) == 1.0
    assert (tmp_path / "run" / state.get("file")).is_file()
    head, row = (tmp_path / "run" / "table.csv").read_text().splitlines()
    named = dict(zip(head.split(","), row.split(","), strict=True))
    load = {"pressure_0_pa": 1e3} if part is TUBE_PART else {"force_z_n": 0.1}
    assert {key: float(named[key]) for key in load} == load
    assert float(named["farthest_m"]) > 0.0


def test_the_mesh_lies_beside_the_part_file(tmp_path, monkeypatch):
    path = written(tmp_path, TUBE_PART)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert load_part(path).geometry.file == str(tmp_path / "tube.vtu")
    assert material_of(load_part(path)).shear_modulus_pa == pytest.approx(72e3, rel=0.01)
