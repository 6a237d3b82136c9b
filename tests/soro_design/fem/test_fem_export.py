"""`soro design export` of part files: STEP, STL, and what is refused."""

import numpy as np
import pytest
from typer.testing import CliRunner

from soro_core.errors import ConfigError
from soro_core.files.stl import read_stl
from soro_design.fem.meshes.surface import is_closed, volume
from soro_ros.cli import application
from tests.soro_design.fem.small_parts import ROD, TUBE, written


@pytest.fixture
def export(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(application(), ["design", "export", *map(str, arguments)])


@pytest.mark.parametrize(
    ("part", "volume_mm3"),
    [(ROD, np.pi * (12.0**2 * 60.0 - 3.0 * 4.0**2 * 54.0)), (TUBE, np.pi * (8.0**2 - 4.0**2) * 20.0)],
)
def test_the_surface_of_a_part_closes_around_its_volume(tmp_path, export, part, volume_mm3):
    """Rims are polygons of the area of their circles."""
    done = export(written(tmp_path, part), "--stl", "part.stl")
    assert done.exit_code == 0, done.output
    points, triangles = read_stl(tmp_path / "part.stl")
    assert is_closed(triangles)
    assert volume(points, triangles) == pytest.approx(1e-9 * volume_mm3, rel=1e-5)


def test_a_shipped_part_becomes_a_step_file(tmp_path, export):
    occ = pytest.importorskip("netgen.occ", reason="needs the extra mesh: pip install 'soro[mesh]'")
    done = export("silicone_rod_three_chambers", "--step", "rod.step")
    assert done.exit_code == 0, done.output
    solid = occ.OCCGeometry(str(tmp_path / "rod.step")).shape
    expected = np.pi * (12.0**2 * 60.0 - 3.0 * 4.0**2 * 54.0)
    assert solid.mass == pytest.approx(expected, rel=1e-9)
    assert f"{expected:.6g} mm3" in done.output


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (["nothing", "--step", "part.step"], ""),
        (["printed_bellows"], ""),
        (["printed_bellows", "--step", "part.stp"], "--step"),
        (["printed_bellows", "--step", "part.step", "--revolve"], "--revolve"),
        (["printed_bellows", "--stl", "part.stl", "--extrude", "4"], "--extrude"),
        ([".", "--step", "part.step"], "--step"),
        (["."], "--stl"),
    ],
)
def test_wrong_use_is_one_line(tmp_path, export, arguments, key):
    error = export(*arguments).exception
    assert isinstance(error, ConfigError)
    assert error.key == key
    assert "\n" not in str(error)
    assert not list(tmp_path.iterdir())
