"""Factors of stiffnesses, by SuperLU and by pardiso."""

import numpy as np
import pytest
from scipy.sparse import csc_array, eye

from soro_design.fem.loads import no_loads, traction
from soro_design.fem.meshes.blocks import block
from soro_design.fem.part import make_part
from soro_design.fem.solve import linear
from soro_design.fem.solve.dissection import rows_dissected
from soro_design.fem.solve.linear import KeptFactors, factorised
from soro_design.fem.solve.multigrid import conjugate_gradients, rigid_motions
from soro_design.fem.solve.newton import solve
from tests.soro_design.fem.moving_parts import SOFT

pytestmark = pytest.mark.numerics


def test_a_singular_matrix_has_no_factors():
    assert factorised(csc_array(np.ones((2, 2)))) is None
    assert factorised(csc_array(np.eye(2))) is not None


@pytest.mark.parametrize(
    ("kind", "space", "counts"), [("quad4", "plane_strain", (70, 40)), ("hex8", "solid", (9, 9, 9))]
)
def test_in_the_order_of_nested_dissection_factors_are_sparser_and_solve_the_same(kind, space, counts):
    mesh = block(kind, space, counts, (1.0,) * len(counts))
    part = make_part(mesh, SOFT, no_loads(mesh))
    found = part.balance(np.zeros_like(mesh.points), 0.0)
    matrix = (part.pattern.matrix(found.data) + 1e5 * eye(part.pattern.n)).tocsc()
    order = rows_dissected(mesh.points, part.pattern)
    assert (np.sort(order) == np.arange(part.pattern.n)).all()
    plain, ordered = factorised(matrix), factorised(matrix, order=order)
    right = np.random.default_rng(0).normal(size=len(order))
    assert ordered.solve(right) == pytest.approx(plain.solve(right), rel=1e-8)
    print(ordered._lu.L.nnz / plain._lu.L.nnz)
    assert ordered._lu.L.nnz < plain._lu.L.nnz


def test_factors_serve_a_matrix_near_by_and_new_ones_one_far_away():
    rng = np.random.default_rng(1)
    near, right = (
        csc_array(np.diag(rng.uniform(1.0, 2.0, 40)) + 0.1 * rng.normal(size=(40, 40))),
        rng.normal(size=40),
    )
    made, kept = [], KeptFactors()

    def factorise(matrix):
        made.append(factorised(matrix))
        return made[-1]

    def solved(matrix, tolerance=1e-10, right=right):
        return kept.solve(matrix, right, tolerance, factorise)

    bent = csc_array(near.toarray() * (1.0 + 1e-3 * rng.normal(size=(40, 40))))
    for matrix in (near, bent):
        assert np.linalg.norm(matrix @ solved(matrix) - right) < 1e-10 * np.linalg.norm(right)
    assert len(made) == 1
    far = csc_array(np.diag(rng.uniform(1.0, 2.0, 40)) + rng.normal(size=(40, 40)))
    assert far @ solved(far) == pytest.approx(right)
    assert len(made) == 2
    # Nothing is asked for that iterations could reach.
    assert far @ solved(far, 0.0) == pytest.approx(right)
    assert np.isnan(solved(far, right=np.full(40, np.nan))).all()
    assert len(made) == 4
    assert solved(csc_array(np.ones((40, 40)))) is None
    assert near @ solved(near) == pytest.approx(right)
    assert len(made) == 6


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


@pytest.fixture
def multigrid(monkeypatch):
    pytest.importorskip("pyamg", reason="needs the extra multigrid: pip install 'soro[multigrid]'")
    monkeypatch.setattr(linear, "LARGE", 0)
    monkeypatch.setattr(linear, "MANY", 10**9)
    used = []
    first = linear.Multigrid.solve
    monkeypatch.setattr(linear.Multigrid, "solve", lambda self, right: used.append(1) or first(self, right))
    return used


def large(is_patch):
    """A block of 6 x 6 x 9 elements, more than the coarsest level has; pressed on top or pulled."""
    mesh = block("hex8", "solid", (6, 6, 9), (1.0, 1.0, 1.5))
    loads = no_loads(mesh)
    for k in range(3):
        loads = loads.hold(mesh.points[:, 2] == 0.0, k)
    top = mesh.faces_at(mesh.points[:, 2] == 1.5)
    loads = loads.press(top, 5e3, is_patch=True) if is_patch else loads
    return make_part(mesh, SOFT, loads.pull(traction(mesh, top, [4e3, 0.0, 2e3])))


@pytest.mark.parametrize("is_patch", [False, True])
def test_multigrid_solves_the_same(is_patch, multigrid, monkeypatch):
    """By conjugate gradients and, under a pressure on an open surface, by GMRES."""
    from soro_design.fem.solve import multigrid as iterations

    by_gmres = []
    first = iterations.gmres
    monkeypatch.setattr(iterations, "gmres", lambda *a, **k: by_gmres.append(1) or first(*a, **k))
    with_it = solve(large(is_patch))
    assert multigrid
    assert bool(by_gmres) == is_patch
    monkeypatch.setattr(linear, "LARGE", 10**9)
    without = solve(large(is_patch))
    assert (with_it.status, without.status) == ("solved", "solved")
    off = np.abs(with_it.last.u - without.last.u).max() / np.abs(without.last.u).max()
    assert off < 1e-6
    assert with_it.iterations <= without.iterations + 1


def test_multigrid_sees_a_part_that_nothing_holds(multigrid):
    done = solve(solid(is_held=False))
    assert (done.status, done.iterations) == ("stopped", 0)
    assert "hold" in done.cause


def test_conjugate_gradients_stop_where_a_matrix_is_not_positive():
    right = np.array([1.0, 2.0, 3.0])
    diagonal = np.array([1.0, 4.0, 9.0])

    def same(x):
        return x

    found = conjugate_gradients(lambda x: diagonal * x, same, right, 1e-12, 10)
    np.testing.assert_allclose(found, right / diagonal)
    assert conjugate_gradients(lambda x: [1.0, -4.0, 9.0] * x, same, right, 1e-12, 10) is None
    assert conjugate_gradients(lambda x: diagonal * x, same, right, 1e-12, 2) is None


def test_rigid_motions_need_no_force_of_a_free_part():
    mesh = block("hex8", "solid", (2, 2, 3), (1.0, 1.0, 1.5))
    K = make_part(mesh, SOFT, no_loads(mesh)).stiffness(np.zeros_like(mesh.points), 0.0)
    held = np.zeros(mesh.points.shape, dtype=bool)
    motions = rigid_motions(mesh.points, held)
    assert np.linalg.matrix_rank(motions) == 6
    assert np.abs(K @ motions).max() < 1e-12 * abs(K).max()
    held[0] = True
    assert not rigid_motions(mesh.points, held)[:3].any()


def test_a_large_solid_without_another_package_is_told_of_one(monkeypatch, caplog):
    monkeypatch.setattr(linear, "LARGE", 0)
    monkeypatch.setattr(linear, "find_spec", lambda name: None)
    linear._advise.cache_clear()
    assert solve(solid()).status == "solved"
    (line,) = caplog.messages
    assert "pip install 'soro[multigrid]'" in line
