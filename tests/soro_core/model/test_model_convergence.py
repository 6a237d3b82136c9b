"""Observed convergence along the backbone: order 2 of `mde`, 4 of Magnus steps, exponential in the degree."""

import numpy as np
import pytest
from numpy.polynomial import legendre

from soro_core import SoftArm, robot_from_dict
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot.basis import shape_values

ORDERS = {"bending_x": 3, "torsion": 0, "elongation": 1, "bending_y": 2}
SCALE = {"bending_x": 6.0, "torsion": 5.0, "elongation": 0.06, "bending_y": 6.0}
LENGTH = 0.2
CONVERGED = 500  # nodes of the arm that is compared with: its own error is about a thousandth
QUANTITIES = ("pose", "inertia", "coriolis", "gravity")


def varying(n_links=1, orders=ORDERS, basis="legendre", youngs_modulus=1e6):
    link = {
        "length": LENGTH / n_links,
        "radius": 0.015,
        "density": 1100.0,
        "material": {"youngs_modulus": youngs_modulus, "shear_modulus": youngs_modulus / 3},
        "strains": {
            name: {} if order is None else {"basis": basis, "order": order} for name, order in orders.items()
        },
    }
    root = np.sqrt(0.5)
    return robot_from_dict({"links": [link] * n_links, "base_quaternion": [0.0, root, 0.0, root]})


def state(seed):
    scale = np.concatenate([np.full(order + 1, SCALE[name]) for name, order in ORDERS.items()])
    return np.random.default_rng(seed).normal(size=(2, len(scale))) * scale


def split(k):
    """Coefficients of the same strains on k equal parts of the link, (k n_q, n_q)."""
    x, w = legendre.leggauss(8)
    rows = []
    for part in range(k):
        at = (2 * part + 1 + x) / k - 1  # nodes of the part, in the coordinate of the whole
        blocks = []
        for order in ORDERS.values():
            own, whole = legendre.legvander(x, order), legendre.legvander(at, order)
            blocks.append((2 * np.arange(order + 1) + 1)[:, None] / 2 * (own.T * w) @ whole)
        n = sum(len(block) for block in blocks)
        row, first = np.zeros((n, n)), 0
        for block in blocks:
            row[first : first + len(block), first : first + len(block)] = block
            first += len(block)
        rows.append(row)
    return np.vstack(rows)


def quantities(arm, q, qd, turn=None):
    """Tip pose, inertia matrix, Coriolis and gravity force, in the coordinates of the undivided link."""
    turn = np.eye(len(q)) if turn is None else turn
    fine, rates = turn @ q, turn @ qd
    return {
        "pose": arm.pose(fine, LENGTH),
        "inertia": turn.T @ arm.inertia_matrix(fine) @ turn,
        "coriolis": turn.T @ arm.coriolis_force(fine, rates),
        "gravity": turn.T @ arm.gravity_force(fine),
    }


def orders(counts, found, right):
    """Slope of the error against the number of steps, over the last pair."""
    logs = {name: [np.log(np.abs(one[name] - right[name]).max()) for one in found] for name in right}
    return {name: -(log[-1] - log[-2]) / np.log(counts[-1] / counts[-2]) for name, log in logs.items()}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_mde_is_of_second_order(seed, figure):
    q, qd = state(seed)
    right = quantities(SoftArm(varying(), nodes=CONVERGED), q, qd)
    counts = [320, 640]
    found = [quantities(SoftArm(varying(), method="mde", steps=n), q, qd) for n in counts]
    observed = orders(counts, found, right)
    figure(f"mde, state {seed}: observed order " + ", ".join(f"{k} {v:.3f}" for k, v in observed.items()))
    assert observed == pytest.approx(dict.fromkeys(QUANTITIES, 2.0), abs=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_magnus_steps_are_of_fourth_order(seed, figure):
    """Links split into k parts of 4 nodes: sub-intervals shrink in proportion, quadrature is far better."""
    q, qd = state(seed)
    right = quantities(SoftArm(varying(), nodes=CONVERGED), q, qd)
    parts = [8, 16]
    found = [quantities(SoftArm(varying(k), nodes=4), q, qd, split(k)) for k in parts]
    observed = orders(parts, found, right)
    figure(f"Magnus, state {seed}: observed order " + ", ".join(f"{k} {v:.3f}" for k, v in observed.items()))
    assert observed == pytest.approx(dict.fromkeys(QUANTITIES, 4.0), abs=0.1)


def test_more_nodes_a_link_are_of_fourth_order_too(figure):
    q, qd = state(0)
    right = quantities(SoftArm(varying(), nodes=CONVERGED), q, qd)
    counts = [32, 64]
    observed = orders(counts, [quantities(SoftArm(varying(), nodes=n), q, qd) for n in counts], right)
    figure("Magnus by nodes: observed order " + ", ".join(f"{k} {v:.3f}" for k, v in observed.items()))
    assert observed == pytest.approx(dict.fromkeys(QUANTITIES, 4.0), abs=0.1)


def backbone(arm, q):
    return np.array([arm.pose(q, s)[:3, 3] for s in np.linspace(0.0, LENGTH, 21)])


def shape_errors(basis, degrees):
    """Distance of the backbone from that of degree 12 [of the length, RMS], clamped and sagging."""
    fields = ("bending_x", "elongation")
    shapes = []
    for degree in (*degrees, 12):
        arm = SoftArm(varying(1, dict.fromkeys(fields, degree), basis, youngs_modulus=1e5), nodes=80)
        shapes.append(backbone(arm, equilibrium(arm, [])))
    return np.array([np.sqrt(((s - shapes[-1]) ** 2).sum(axis=1).mean()) / LENGTH for s in shapes[:-1]])


@pytest.mark.parametrize("basis", ["legendre", "chebyshev"])
def test_polynomials_converge_exponentially(basis, figure):
    """A straight line on semi-log paper over six decades: a degree divides the error by five on the mean."""
    degrees = range(9)
    errors = np.log10(shape_errors(basis, degrees))
    slope, start = np.polyfit(degrees, errors, 1)
    off = np.abs(errors - (start + slope * np.array(degrees))).max()
    figure(
        f"{basis}: backbone error {10 ** errors[0]:.1e} at degree 0 to {10 ** errors[-1]:.1e} at degree 8, "
        f"a factor of {10**-slope:.1f} a degree, within {off:.2f} decades of the line"
    )
    assert 10**-slope > 4.5
    assert off < 0.75
    assert np.all(errors[:-2] - errors[2:] > np.log10(4.0))  # no plateau


def test_links_of_constant_strain_converge_by_the_square(figure):
    """The same arm, cut into links: what the polynomials are to be compared with."""
    fields = {"bending_x": None, "elongation": None}
    right = SoftArm(varying(1, {"bending_x": 12, "elongation": 12}, youngs_modulus=1e5), nodes=40)
    shape = backbone(right, equilibrium(right, []))
    errors = []
    for n in (8, 16):
        arm = SoftArm(varying(n, fields, youngs_modulus=1e5))
        errors.append(np.sqrt(((backbone(arm, equilibrium(arm, [])) - shape) ** 2).sum(axis=1).mean()))
    order = np.log2(errors[0] / errors[1])
    figure(f"constant strain: order {order:.3f} in the number of links")
    assert order == pytest.approx(2.0, abs=0.1)


def test_split_strains_are_the_same_strains():
    q, _ = state(3)
    whole, part = varying().links[0], varying(4).links[0]
    fine = (split(4) @ q).reshape(4, -1)
    for i in range(4):
        at = np.array([0.0, 0.02, 0.05])
        got = fine[i][:, None] * shape_values(part, at)
        want = q[:, None] * shape_values(whole, at + 0.05 * i)
        np.testing.assert_allclose(got[:4].sum(axis=0), want[:4].sum(axis=0), atol=1e-12)
