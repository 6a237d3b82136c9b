"""Factors of stiffnesses, by SuperLU and by pardiso."""

import numpy as np
import pytest
from scipy.sparse import csc_array

from soro_design.fem.loads import no_loads, traction
from soro_design.fem.meshes.blocks import block
from soro_design.fem.part import make_part
from soro_design.fem.solve import linear
from soro_design.fem.solve.linear import factorised
from soro_design.fem.solve.newton import solve
from tests.soro_design.fem.moving_parts import SOFT

pytestmark = pytest.mark.numerics


def test_a_singular_matrix_has_no_factors():
    assert factorised(csc_array(np.ones((2, 2)))) is None
    assert factorised(csc_array(np.eye(2))) is not None


def solid(is_held=True):
    mesh = block("hex8", "solid", (2, 2, 3), (1.0, 1.0, 1.5))
    loads = no_loads(mesh)
    for k in range(3 if is_held else 2):
        loads = loads.hold(mesh.points[:, 2] == 0.0, k)
    top = mesh.faces_at(mesh.points[:, 2] == 1.5)
    return make_part(
        mesh, SOFT, loads.pull(traction(mesh, top, [2e3, 0.0, 5e3])).press(top, 1e3, is_patch=True)
    )


@pytest.fixture
def pardiso(monkeypatch):
    pytest.importorskip("pypardiso", reason="needs the extra pardiso: pip install 'soro[pardiso]'")
    monkeypatch.setattr(linear, "MANY", 0)


def test_pardiso_solves_the_same(pardiso, monkeypatch):
    """Symmetric and, under a pressure on an open surface, not."""
    used = []
    first = linear._Pardiso.solve
    monkeypatch.setattr(linear._Pardiso, "solve", lambda self, right: used.append(1) or first(self, right))
    with_it = solve(solid())
    assert used
    monkeypatch.setattr(linear, "MANY", 10**9)
    without = solve(solid())
    assert (with_it.status, with_it.iterations) == ("solved", without.iterations)
    np.testing.assert_allclose(with_it.last.u, without.last.u, atol=1e-10)


def test_pardiso_sees_a_part_that_nothing_holds(pardiso):
    done = solve(solid(is_held=False))
    assert (done.status, done.iterations) == ("stopped", 0)
    assert "hold" in done.cause


def test_a_small_part_and_a_section_do_without_pardiso(monkeypatch):
    def refuse(*_):
        raise AssertionError

    monkeypatch.setattr(linear._Pardiso, "__init__", refuse)
    monkeypatch.setattr(linear, "find_spec", lambda name: name)
    assert solve(solid()).status == "solved"
    monkeypatch.setattr(linear, "MANY", 0)
    mesh = block("quad4", "plane_strain", (2, 2), (1.0, 1.0))
    part = make_part(mesh, SOFT, no_loads(mesh).hold(mesh.points[:, 1] == 0.0, 0).hold([0, 3], 1))
    assert solve(part).status == "solved"
    with pytest.raises(AssertionError):
        solve(solid())
