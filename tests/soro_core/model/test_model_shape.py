"""Links that taper, or are bent and twisted at rest, against closed forms and boundary-value problems."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import fresnel, iv, jv, kv, yv
from shaped_arms import LAWS, LENGTH, MATERIAL, SECTIONS, link_of, shaped_arm, state_of, uniform_helix

from soro_core import SoftArm, equilibrium, robot_from_dict
from soro_core.errors import ModelError
from soro_core.robot import with_basis
from tests.refused import fails

pytestmark = pytest.mark.numerics
# Of the length.
TO_REFERENCE = 1e-6
WEIGHTLESS = {"gravity": [0.0, 0.0, 0.0]}
PLACES = np.linspace(0.0, LENGTH, 21)


def arm_of(*links, nodes=None, **keys):
    return SoftArm(robot_from_dict({"links": list(links), **keys}), nodes=nodes)


def backbone(arm, q=None):
    return np.array([arm.pose(np.zeros(arm.n_q) if q is None else q, s)[:3, 3] for s in PLACES])


@pytest.mark.parametrize("method", [{}, {"method": "mde", "steps": 1000}], ids=["exact", "mde"])
def test_a_link_at_rest_is_a_helix(method):
    """Tangent z turned about the axis Gamma, and its integral."""
    kx, ky, torsion = 9.0, -4.0, 12.0
    link = link_of(
        sections=None, radius=0.01, rest_curvature_per_m=[kx, ky], rest_torsion_per_m=torsion, strains=None
    )
    arm = SoftArm(robot_from_dict({"links": [link]}), **method)
    turn = np.array([-ky, kx, torsion])
    rate = np.linalg.norm(turn)
    axis, z = turn / rate, np.array([0.0, 0.0, 1.0])
    along, across = (z @ axis) * axis, z - (z @ axis) * axis
    s = PLACES[:, None]
    wanted = s * along + np.sin(rate * s) / rate * across + (1 - np.cos(rate * s)) / rate * np.cross(axis, z)
    np.testing.assert_allclose(backbone(arm), wanted, atol=TO_REFERENCE * LENGTH)
    # Its radius and pitch, those of textbooks.
    away = wanted - np.cross(axis, z) / rate
    away -= (away @ axis)[:, None] * axis
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), np.hypot(kx, ky) / rate**2, rtol=1e-12)


def test_rest_values_by_place_that_are_equal_are_those_of_the_link():
    rest = {"rest_curvature_per_m": [9.0, -4.0], "rest_torsion_per_m": 12.0}
    plain = arm_of(link_of(sections=None, radius=0.01, strains=None, **rest), nodes=20)
    rows = [{"place": s, "radius": 0.01, **rest} for s in (0.0, 0.05, LENGTH)]
    by_place = arm_of(link_of(sections=rows, strains=None, rest_torsion_per_m=None), nodes=30)
    q, qd = state_of(plain)
    for f in (backbone, lambda arm, q: arm.forward_dynamics(q, qd, [])):
        np.testing.assert_allclose(f(by_place, q), f(plain, q), rtol=1e-8, atol=1e-10)


def test_curvature_that_grows_evenly_is_a_clothoid():
    rate = 150.0  # 1/m^2
    rows = [{"place": s, "rest_curvature_per_m": [rate * s, 0.0]} for s in (0.0, LENGTH)]
    link = link_of(sections=rows, radius=0.01, rest_torsion_per_m=None, strains=None)
    scale = np.sqrt(np.pi / rate)
    x, z = (scale * part for part in fresnel(PLACES / scale))
    wanted = np.column_stack([x, 0.0 * x, z])
    off = [np.abs(backbone(arm_of(link, nodes=n)) - wanted).max() / LENGTH for n in (10, 20, 40)]
    assert off[0] < 1e-4
    assert off[1] < 0.1 * off[0]
    assert off[2] < TO_REFERENCE


def elastica(robot, weight=9.81):
    """Shape of a link that bends in one plane and is clamped along z, under its weight and tip mass along x.

    EI (theta' - kappa_0)' = -W cos(theta), W the weight beyond: angle and place at `PLACES`.
    """
    (link,) = robot.links
    columns = {key: [getattr(row, key) for row in link.sections] for key in ("place", "radius", "stiffness")}
    kappa = [row.rest_curvature_per_m[0] for row in link.sections]
    places = columns["place"]

    def rates(s, y):
        radius = np.interp(s, places, columns["radius"])
        stiffness = 5e5 * np.pi * radius**4 / 4 * np.interp(s, places, columns["stiffness"])
        bent = np.interp(s, places, kappa) + y[1] / stiffness
        per_m = 1100.0 * np.pi * radius**2
        # Angle, moment, mass beyond, x, z.
        return np.array([bent, -weight * y[2] * np.cos(y[0]), -per_m, np.sin(y[0]), np.cos(y[0])])

    def ends(a, b):
        return np.array([a[0], b[1], b[2] - robot.tip_mass, a[3], a[4]])

    mesh = np.unique(np.concatenate([np.linspace(0.0, LENGTH, 200), places]))
    found = solve_bvp(rates, ends, mesh, np.zeros((5, len(mesh))), tol=1e-10, max_nodes=100_000)
    assert found.success, found.message
    theta, _, _, x, z = found.sol(PLACES)
    return theta, np.column_stack([x, 0.0 * x, z])


BENDS = {"bending_x": {"basis": "legendre", "order": 12}}
STIFF = {**MATERIAL, "shear_correction": False}
PLANAR = [{**row, "rest_curvature_per_m": [row["rest_curvature_per_m"][0], 0.0]} for row in SECTIONS]


@pytest.mark.parametrize("rows", [PLANAR[::2], PLANAR], ids=["two sections", "three"])
def test_a_link_under_its_weight_is_the_elastica_of_its_sections(rows, figure):
    """Radius, stiffness, mass and rest curvature by place; a mass at the tip; bent by a radian and more."""
    rows = [{**row, "place": s} for row, s in zip(rows, np.linspace(0, LENGTH, len(rows)), strict=True)]
    pieces = len(rows) - 1
    link = link_of(sections=rows, rest_torsion_per_m=None, strains=BENDS, material=STIFF)
    arm = arm_of(link, gravity=[9.81, 0.0, 0.0], tip_mass=0.004)
    # The strain has a bend where the sections have one: there a link ends.
    q = equilibrium(fine := SoftArm(arm.robot.refine(pieces)), [])
    theta, wanted = elastica(arm.robot)
    assert abs(theta[-1]) > 1.0
    off = np.abs(backbone(fine, q) - wanted).max() / LENGTH
    figure(f"elastica of {len(rows)} sections: {off:.1e} of the length off")
    assert off < TO_REFERENCE


def test_a_cone_vibrates_as_its_bessel_functions_say(figure):
    """First three frequencies of a slender truncated cone, clamped at its wide end (Kirchhoff, 1882).

    With x from the apex (x^4 w'')'' = k^4 x^2 w has the solutions Z_2(2 k sqrt(x)) / x.
    """
    tip, radius = 0.4, 1e-4 * LENGTH
    rows = [{"place": 0.0, "radius": radius}, {"place": LENGTH, "radius": tip * radius}]
    fields = {"bending_y": {"basis": "legendre", "order": 10}}
    arm = arm_of(
        link_of(sections=rows, rest_torsion_per_m=None, strains=fields, material=STIFF),
        nodes=80,
        **WEIGHTLESS,
    )
    q = np.zeros(arm.n_q)
    found = np.sqrt(eigh(arm.stiffness_matrix(q), arm.inertia_matrix(q), eigvals_only=True)[:3])

    def row(n, k, x, signs):
        return [sign * f(n, 2 * k * np.sqrt(x)) for sign, f in zip(signs, (jv, yv, iv, kv), strict=True)]

    def clamped_free(k):
        ends = (
            row(2, k, 1.0, (1, 1, 1, 1)),  # w
            row(3, k, 1.0, (-1, -1, 1, -1)),  # w'
            row(4, k, tip, (1, 1, 1, 1)),  # w''
            row(3, k, tip, (1, 1, 1, -1)),  # (x^4 w'')'
        )
        return np.linalg.det(np.array(ends))

    at = np.linspace(1.0, 25.0, 600)
    values = [clamped_free(k) for k in at]
    roots = [
        brentq(clamped_free, a, b, xtol=1e-13)
        for a, b, u, v in zip(at, at[1:], values, values[1:], strict=False)
        if u * v < 0.0
    ][:3]
    # x over the cone's whole length, LENGTH / (1 - tip).
    scale = np.sqrt(5e5 * radius**2 / 4 / 1100.0) * ((1.0 - tip) / LENGTH) ** 2
    off = found / (np.array(roots) ** 2 * scale) - 1.0
    figure(f"cone: first frequencies {np.abs(off).max():.1e} off")
    assert np.abs(off).max() < 1e-6


def test_mass_and_stiffness_by_place_are_integrals_over_the_link():
    arm = arm_of(link_of(strains={"bending_x": {"basis": "legendre", "order": 2}}, material=STIFF))
    (link,) = arm.robot.links
    s = np.linspace(0.0, LENGTH, 20_001)
    radius = np.interp(s, [0.0, 0.08, 0.2], [0.015, 0.011, 0.006])
    factor = np.interp(s, [0.0, 0.08, 0.2], [1.0, 1.5, 0.8])
    assert link.radius == 0.015
    assert link.mass == pytest.approx(1100.0 * np.trapezoid(np.pi * radius**2, s), rel=1e-7)
    assert arm.tables.mass_share.sum() == pytest.approx(1.0, rel=1e-14)
    phi = np.polynomial.legendre.legvander(2 * s / LENGTH - 1, 2).T
    per_length = factor * 5e5 * np.pi * radius**4 / 4
    wanted = np.trapezoid(per_length * phi[:, None] * phi[None], s)
    np.testing.assert_allclose(arm.stiffness_matrix(np.zeros(3)), wanted, rtol=1e-6, atol=1e-9)
    # The viscosity follows the radius alone.
    wanted = np.trapezoid(3 * 300.0 * np.pi * radius**4 / 4 * phi[:, None] * phi[None], s)
    np.testing.assert_allclose(arm.damping_matrix(), wanted, rtol=1e-6, atol=1e-12)


def test_a_mass_per_length_is_the_mass_of_the_link():
    rows = [{"place": s, "mass_per_m": m} for s, m in ((0.0, 0.4), (0.1, 0.3), (LENGTH, 0.1))]
    arm = arm_of(link_of(sections=rows, radius=0.01, density=None), gravity=[0.0, 0.0, -1.0])
    assert arm.robot.links[0].mass == pytest.approx(0.1 * 0.35 + 0.1 * 0.2, rel=1e-14)
    # Its centre: the energy of the straight arm.
    straight = arm_of(link_of(sections=rows, radius=0.01, density=None, rest_torsion_per_m=None))
    s = np.linspace(0.0, LENGTH, 20_001)
    moment = np.trapezoid(s * np.interp(s, [0.0, 0.1, LENGTH], [0.4, 0.3, 0.1]), s)
    q = np.zeros(straight.n_q)
    assert straight.energy(q, q)[1] == pytest.approx(9.81 * moment, rel=1e-7)


def test_laws_of_a_link_hold_for_its_mean_and_follow_the_section():
    """A uniform strain stores the same as in a link without sections; one near the tip stores less."""
    link = link_of(material=None, density=None, **LAWS)
    shaped, plain = arm_of(link), arm_of({**link, "sections": [], "radius": 0.015})
    uniform = np.array([0.05, 0.0, 6.0, 0.0, -2.0, 0.0])
    still = np.zeros(6)
    assert shaped.energy(uniform, still)[2] == pytest.approx(plain.energy(uniform, still)[2], rel=1e-12)
    at_tip, at_base = np.array([0.0, 0.0, 3.0, 3.0, 0.0, 0.0]), np.array([0.0, 0.0, 3.0, -3.0, 0.0, 0.0])
    assert shaped.energy(at_tip, still)[2] < 0.3 * shaped.energy(at_base, still)[2]
    # Power 2 of the radius for the elongation, 4 for bending; in bends so small that the laws are constants.
    small = 1e-4 * np.eye(6)
    s = (np.arange(20_000) + 0.5) / 20_000
    for one, strain, power, k in ((small[1], "elongation", 2, 200.0 * LENGTH**2), (small[3], "", 4, 0.01)):
        radius = np.interp(s, [0.0, 0.4, 1.0], [0.015, 0.011, 0.006])
        each = radius**power * np.interp(s, [0.0, 0.4, 1.0], [1.0, 1.5, 0.8])
        mean = (each * (1e-4 * (2 * s - 1)) ** 2).mean() / each.mean()
        wanted = 0.5 * k * mean * (1.0 if strain else LENGTH**2)
        assert shaped.energy(one, still)[2] == pytest.approx(wanted, rel=1e-5, abs=0.0)


def test_forces_are_gradients_and_mdot_minus_2c_is_skew():
    arm = shaped_arm(tip_mass=0.01)
    q, qd = state_of(arm)
    zero, step = np.zeros(arm.n_q), 1e-5
    for force, which in ((arm.gravity_force, 1), (arm.elastic_force, 2)):
        wanted = [
            (arm.energy(q + e, zero)[which] - arm.energy(q - e, zero)[which]) / (2 * step)
            for e in step * np.eye(arm.n_q)
        ]
        np.testing.assert_allclose(force(q), wanted, rtol=1e-5, atol=1e-7 * np.abs(wanted).max())
    hessian = [(arm.elastic_force(q + e) - arm.elastic_force(q - e)) / 2e-5 for e in step * np.eye(arm.n_q)]
    np.testing.assert_allclose(arm.stiffness_matrix(q), hessian, rtol=1e-6, atol=1e-8 * np.abs(hessian).max())
    assert arm.energy(q, qd)[0] == pytest.approx(0.5 * qd @ arm.inertia_matrix(q) @ qd, rel=1e-12)
    rate = (arm.inertia_matrix(q + 1e-6 * qd) - arm.inertia_matrix(q - 1e-6 * qd)) / 2e-6
    skew = rate - 2 * arm.coriolis_matrix(q, qd)
    np.testing.assert_allclose(skew, -skew.T, atol=1e-7 * np.abs(rate).max())


@pytest.mark.parametrize(
    "keys", [{"material": STIFF}, {"material": None, "density": None, **LAWS}], ids=["material", "laws"]
)
def test_the_parts_of_a_link_are_the_link(keys):
    """Uniform strains: the same shape, energies and inertia."""
    whole = arm_of(link_of(strains=None, **keys), nodes=120)
    parts = SoftArm(whole.robot.refine(3), nodes=40)
    assert sum(link.mass for link in parts.robot.links) == pytest.approx(whole.robot.links[0].mass, rel=1e-12)
    q, qd = np.array([0.04, 5.0, -3.0]), np.array([0.3, 20.0, 10.0])
    fine, fine_rate = np.tile(q, 3), np.tile(qd, 3)
    np.testing.assert_allclose(backbone(parts, fine), backbone(whole, q), atol=1e-8)
    np.testing.assert_allclose(parts.energy(fine, fine_rate), whole.energy(q, qd), rtol=1e-6)
    if whole.robot.links[0].k_b is not None:
        s = (np.arange(30_000) + 0.5) / 30_000
        radius, factor = (np.interp(s, [0.0, 0.4, 1.0], ends) for ends in ([15, 11, 6], [1.0, 1.5, 0.8]))
        for law, power in (("k_e", 2), ("k_b", 4)):
            share = (radius**power * factor).reshape(3, -1).mean(axis=1)
            first, second, third = 3.0 * np.array(LAWS[law])
            for link, stiffer in zip(parts.robot.links, share / share.mean(), strict=True):
                wanted = (stiffer * first, stiffer * second, third)
                np.testing.assert_allclose(getattr(link, law), wanted, rtol=1e-6)
    damping = np.tile(np.eye(3), (3, 1))
    np.testing.assert_allclose(
        damping.T @ parts.damping_matrix() @ damping, whole.damping_matrix(), rtol=1e-10, atol=1e-15
    )
    expanded = SoftArm(with_basis(whole.robot, "legendre", 2), nodes=120)
    spread = np.zeros(9)
    spread[::3] = q
    np.testing.assert_allclose(backbone(expanded, spread), backbone(whole, q), atol=1e-8)


def test_shear_left_out_is_corrected_along_a_taper(figure):
    """The first frequency with shear strains is that without, softened, docs/model.md (19)."""
    rows = [{"place": 0.0, "radius": 0.015}, {"place": LENGTH, "radius": 0.006}]

    def first(strains):
        fields = {name: {"basis": "legendre", "order": 6} for name in strains}
        arm = arm_of(link_of(sections=rows, rest_torsion_per_m=None, strains=fields), **WEIGHTLESS)
        K, M = arm.stiffness_matrix(np.zeros(arm.n_q)), arm.inertia_matrix(np.zeros(arm.n_q))
        return np.sqrt(eigh(K, M, eigvals_only=True)[0])

    off = first(["bending_x"]) / first(["bending_x", "shear_x"]) - 1.0
    figure(f"shear left out along a taper: frequency {off:.1e} off")
    assert abs(off) < 1e-6


def test_an_obstacle_touches_the_section_that_is_there():
    rows = [{"place": 0.0, "radius": 0.02}, {"place": LENGTH, "radius": 0.01}]
    link = link_of(sections=rows, rest_torsion_per_m=None)
    depths = []
    for gap in (0.0149, 0.0151, 0.0099, 0.0101):
        wall = {"point": [gap, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0], "stiffness": 1e3}
        arm = arm_of(link, contacts={"planes": [wall], "points_per_link": 2})
        depths.append(arm.external_forces(np.zeros(arm.n_q)).force[:, 0])
    np.testing.assert_allclose(depths, [[-0.1, 0], [0, 0], [-5.1, -0.1], [-4.9, 0]], atol=1e-9)


def test_mde_takes_rest_strain_and_refuses_sections():
    link = uniform_helix(sections=None, radius=0.01)
    arms = [arm_of(link), SoftArm(robot_from_dict({"links": [link]}), method="mde", steps=800)]
    q, qd = state_of(arms[0])
    exact, mde = (arm.forward_dynamics(q, qd, []) for arm in arms)
    np.testing.assert_allclose(mde, exact, rtol=1e-4)
    with fails(ModelError, "mde", "exact", key="links[0].sections"):
        SoftArm(arm_of(link_of()).robot, method="mde")
