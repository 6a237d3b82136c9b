"""STEP files of parts: volume and box of the solid, read again, against closed forms."""

import sys
from importlib.util import find_spec

import numpy as np
import pytest

from soro_core.config import with_changes
from soro_core.errors import ModelError
from soro_core.extras import MissingPackageError
from soro_design.parts.file import load_part
from soro_design.parts.step import write_step
from tests.refused import fails
from tests.soro_design.fem.small_parts import ROD, TUBE, written


@pytest.fixture
def again(tmp_path):
    """Write a part as STEP, and read the solid again."""
    occ = pytest.importorskip("netgen.occ", reason="needs the extra mesh: pip install 'soro[mesh]'")

    def read(geometry):
        volume_m3 = write_step(tmp_path / "part.step", geometry)
        solid = occ.OCCGeometry(str(tmp_path / "part.step")).shape
        assert solid.mass == pytest.approx(1e9 * volume_m3, rel=1e-9)
        assert len(solid.solids) == 1
        return solid

    return read


def box(solid):
    return np.array([tuple(corner) for corner in solid.bounding_box])


@pytest.mark.parametrize("taper", [1.0, 0.6])
def test_a_rod_has_closed_chambers_of_exact_dimensions(tmp_path, again, taper, figure):
    geometry = load_part(written(tmp_path, ROD, geometry={**ROD["geometry"], "taper": taper})).geometry
    solid = again(geometry)

    def cone(radius, length, low, high):
        return np.pi * radius**2 * length * (low**2 + low * high + high**2) / 3.0

    # Radius 12, length 60; three chambers of radius 4 between plugs of 3 mm.
    low, high = (1.0 + (taper - 1.0) * z / 60.0 for z in (3.0, 57.0))
    expected = cone(12.0, 60.0, 1.0, taper) - 3.0 * cone(4.0, 54.0, low, high)
    figure(f"STEP of a rod, taper {taper}: volume {solid.mass / expected - 1:+.1e} off its formula")
    assert solid.mass == pytest.approx(expected, rel=1e-8)
    np.testing.assert_allclose(box(solid), [[-12.0, -12.0, 0.0], [12.0, 12.0, 60.0]], atol=1e-5)
    # The outside, and one closed surface around the air of each chamber.
    assert len(solid.shells) == 4


@pytest.mark.parametrize("end_m", [0.0, 4.1e-3])
def test_bellows_have_the_volume_of_their_pieces(again, end_m):
    """Of half a lobe, by Pappus: half a neck, a side, a fillet, half the top; and the tubes at the ends."""
    geometry = with_changes(load_part("printed_bellows").geometry, end_m=end_m)
    solid = again(geometry)
    neck, fillet, wall = 1.3375, 1.1, 0.8
    inner, outer = 3.6 + neck, 12.6 - fillet

    def quarter(centre, low, high, sign):
        return 2.0 * np.pi * (centre * np.pi / 4.0 * (high**2 - low**2) + sign * (high**3 - low**3) / 3.0)

    half = quarter(inner, neck, neck + wall, -1.0) + np.pi * (outer**2 - inner**2) * wall
    half += quarter(outer, fillet - wall, fillet, 1.0)
    half += 2.0 * np.pi * wall * (0.5 * 4.3 - fillet) * (12.6 - 0.5 * wall)
    tubes = 2.0 * 1e3 * end_m * np.pi * (3.6**2 - (3.6 - wall) ** 2)
    assert solid.mass == pytest.approx(16.0 * half + tubes, rel=1e-9)
    # Around a fillet the box of Open CASCADE is that of a whole torus: take the corners.
    x, y, z = np.array([tuple(corner.p) for corner in solid.vertices]).T
    np.testing.assert_allclose(
        [z.min(), z.max(), np.hypot(x, y).max()], [0.0, 55.8 + 2e3 * end_m, 12.6], atol=1e-9
    )
    np.testing.assert_allclose(np.hypot(x, y).min(), 3.6 - wall, atol=1e-9)


def test_a_tube_has_its_volume(tmp_path, again):
    solid = again(load_part(written(tmp_path, TUBE)).geometry)
    assert solid.mass == pytest.approx(np.pi * (8.0**2 - 4.0**2) * 20.0, rel=1e-9)


def test_what_is_refused(tmp_path, monkeypatch):
    geometry = load_part(written(tmp_path, TUBE)).geometry
    if find_spec("netgen"):
        with fails(ModelError, key="path"):
            write_step(tmp_path / "none" / "part.step", geometry)
    for name in ("netgen", "netgen.occ"):
        monkeypatch.setitem(sys.modules, name, None)
    with fails(MissingPackageError, "'soro[mesh]'"):
        write_step(tmp_path / "part.step", geometry)
    assert not (tmp_path / "part.step").exists()
