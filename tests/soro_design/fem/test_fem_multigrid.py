"""Levels of multigrid: their sweeps, their cycle, and how many iterations they leave."""

import weakref

import numpy as np
import pytest
from scipy.sparse import bsr_array, csc_array

from soro_design.fem.loads import no_loads, traction
from soro_design.fem.meshes.blocks import block
from soro_design.fem.multigrid.sweeps import fill_residual, sweep_down, sweep_up
from soro_design.fem.part import make_part
from soro_design.fem.solve import equations, linear
from soro_design.fem.solve.equations import Equations
from soro_design.fem.solve.multigrid import conjugate_gradients, rigid_motions
from soro_design.fem.solve.newton import solve
from tests.soro_design.fem.moving_parts import SOFT

pytestmark = pytest.mark.numerics


def clamped(counts):
    """A block of some elements, as long as they are many, clamped at its bottom and pulled askew."""
    mesh = block("hex8", "solid", counts, tuple(0.1 * n for n in counts))
    z = mesh.points[:, 2]
    loads = no_loads(mesh).pull(traction(mesh, mesh.faces_at(z > z.max() - 1e-9), [2e3, 0.0, 5e3]))
    for k in range(3):
        loads = loads.hold(z == 0.0, k)
    return make_part(mesh, SOFT, loads)


def levels_of(part):
    """The undeformed stiffness of a part as rows of blocks, and its levels."""
    from soro_design.fem.multigrid.levels import Levels

    at, zero = Equations(part), np.zeros_like(part.mesh.points)
    matrix = bsr_array(at.reduced(part.balance(zero, 0.0)), blocksize=(3, 3))
    return matrix, Levels(matrix, rigid_motions(part.mesh.points, at.is_held))


def test_sweeps_solve_with_the_triangles_of_a_matrix():
    rng = np.random.default_rng(0)
    whole = rng.normal(size=(12, 12)) + 20.0 * np.eye(12)
    whole[:3, 6:9] = whole[6:9, :3] = 0.0
    rows = bsr_array(whole, blocksize=(3, 3))
    assert len(rows.indices) == 14
    below, on = np.zeros((12, 12)), np.zeros((12, 12))
    for i in range(0, 12, 3):
        below[i : i + 3, :i] = whole[i : i + 3, :i]
        on[i : i + 3, i : i + 3] = whole[i : i + 3, i : i + 3]
    inverse = np.concatenate([np.linalg.inv(on[i : i + 3, i : i + 3]).ravel() for i in range(0, 12, 3)])
    right, found, residual = rng.normal(size=12), np.empty(12), np.empty(12)
    of = rows.indptr, rows.indices, rows.data.ravel()
    sweep_up(*of, inverse, right, found)
    np.testing.assert_allclose(found, np.linalg.solve(below + on, right))
    fill_residual(*of, found, residual)
    np.testing.assert_allclose(residual, right - whole @ found, atol=1e-14)
    before = found.copy()
    sweep_down(*of, inverse, right, found)
    np.testing.assert_allclose(found, np.linalg.solve(whole - below, right - below @ before))


@pytest.fixture
def pyamg():
    pytest.importorskip("pyamg", reason="needs the extra multigrid: pip install 'soro[multigrid]'")


def test_a_cycle_is_symmetric_and_positive(pyamg):
    matrix, levels = levels_of(clamped((8, 8, 12)))
    a, b = np.random.default_rng(0).normal(size=(2, matrix.shape[0]))
    near_a, near_b = levels.cycle(a), levels.cycle(b)
    assert b @ near_a == pytest.approx(a @ near_b, rel=1e-5)
    assert a @ near_a > 0.0
    np.testing.assert_allclose(
        levels.cycle(a + 2.0 * b), near_a + 2.0 * near_b, atol=1e-9 * np.abs(near_a).max()
    )


def test_a_larger_part_takes_hardly_more_iterations(pyamg):
    counts = []
    for n in (6, 12):
        matrix, levels = levels_of(clamped((n, n, 2 * n)))
        right, products = np.random.default_rng(0).normal(size=matrix.shape[0]), []
        found = conjugate_gradients(
            lambda x, m=matrix, p=products: p.append(1) or m @ x, levels.cycle, right, 1e-8, 100
        )
        assert np.linalg.norm(matrix @ found - right) < 1e-7 * np.linalg.norm(right)
        counts.append(len(products))
    assert counts[1] < 1.2 * counts[0] < 90


def test_solutions_are_the_same_to_the_last_bit_and_take_no_random_numbers_of_others(pyamg, monkeypatch):
    monkeypatch.setattr(linear, "LARGE", 0)
    monkeypatch.setattr(linear, "MANY", 10**9)
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first, second = (solve(clamped((6, 6, 9))).last.u for _ in range(2))
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002
    assert (first == second).all()


def test_a_matrix_is_symmetric_up_to_rounding():
    rng = np.random.default_rng(0)
    half = rng.normal(size=(60, 60))
    whole = half + half.T
    assert linear._is_symmetric(csc_array(whole))
    assert linear._is_symmetric(csc_array(whole * (1.0 + 1e-16 * rng.normal(size=whole.shape))))
    whole[7, 31] += 1e-10
    assert not linear._is_symmetric(csc_array(whole))


def test_factors_go_before_the_next_ones_come(monkeypatch):
    """Two at a time would be the most memory of a solution."""
    alive = weakref.WeakSet()
    most = []
    first = equations.factorised

    def counted(*args, **given):
        most.append(len(alive))
        found = first(*args, **given)
        alive.add(found)
        return found

    monkeypatch.setattr(equations, "factorised", counted)
    assert solve(clamped((2, 2, 3))).status == "solved"
    assert len(most) > 2
    assert max(most) == 0
