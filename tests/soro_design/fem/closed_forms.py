"""Parts with closed forms: thick walls, Cook's membrane, a thin cantilever; for tests and benchmarks."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.sparse.linalg import LinearOperator, eigsh

from soro_design.fem.elements.material import material_from_dict
from soro_design.fem.loads import no_loads, traction
from soro_design.fem.meshes.blocks import block, mapped, sphere, tube
from soro_design.fem.part import make_part
from soro_design.fem.solve.linear import factorised
from soro_design.fem.solve.newton import solve
from soro_design.fem.solve.states import SolverSettings

# Inner radius, pressure over mu, and what the bulk modulus adds to the radius.
THICK = {"cylinder": (1.5, 0.428228, 2.6e-5), "sphere": (1.4, 0.698421, None)}


def neo_hooke(mu, bulk):
    # nu of the pair: (3 K - 2 mu) / (6 K + 2 mu)
    nu = (3 * bulk - 2 * mu) / (6 * bulk + 2 * mu)
    return material_from_dict(
        {"kind": "hyperelastic", "source": "a test", "c1_pa": mu / 2, "poisson_ratio": nu}
    )


def thick_wall(name, n, is_averaged=True):
    """Stretch of the inner radius 1 of a wall up to 2, with n x 2 n elements."""
    _, pressure, _ = THICK[name]
    mesh = (tube if name == "cylinder" else sphere)("quad4", (n, 2 * n), (1.0, 2.0))
    x, y = mesh.points.T
    radius = np.hypot(x, y)
    loads = no_loads(mesh).hold(y == 0.0, 1).hold(x == 0.0, 0)
    loads = loads.press(mesh.faces_at(np.abs(radius - 1.0) < 1e-9), pressure)
    done = solve(make_part(mesh, neo_hooke(1.0, 1e4), loads, is_averaged))
    assert done.status == "solved", done.cause
    at = np.flatnonzero((np.abs(radius - 1.0) < 1e-9) & (y < 1e-9))[0]
    return 1.0 + done.last.u[at, 0]


def exact(name, bulk=1e4):
    """Stretch of the inner radius by the radial equation of the compressible wall: shooting from inside."""
    _, pressure, _ = THICK[name]
    n = 1 if name == "cylinder" else 2  # hoop directions that stretch

    def stress(along, hoop):
        """Nominal radial and hoop stress at principal stretches."""
        J = along * hoop**n
        I1 = along**2 + n * hoop**2 + (2 - n)
        common = -(J ** (-2 / 3)) * I1 / 3 + bulk * (J - 1) * J
        return tuple((J ** (-2 / 3) * s**2 + common) / s for s in (along, hoop))

    def stretch(radial, hoop):
        """Radial stretch that gives a radial stress."""
        return brentq(lambda s: stress(s, hoop)[0] - radial, 0.02, 5.0, xtol=1e-15, rtol=1e-14)

    def slope(R, state):
        r, radial = state
        along, hoop = stretch(radial, r / R), r / R
        return [along, n * (stress(along, hoop)[1] - radial) / R]

    def outer_stress(inner):
        start = [inner, -pressure * inner**n]
        return solve_ivp(slope, (1.0, 2.0), start, rtol=1e-10, atol=1e-12).y[1, -1]

    guess = THICK[name][0]
    # The less bulk modulus, the farther beyond.
    return brentq(outer_stress, guess * (1 - 2e-4), guess * (1 + 4e-4 * max(1.0, 5e3 / bulk)), xtol=1e-10)


def cook(n, is_averaged, bulk=400890.0):
    """Rise of the corner of Cook's membrane of quad4."""

    def place(unit):
        x, s = 48.0 * unit[:, 0], unit[:, 1]
        low, high = 44.0 * unit[:, 0], 44.0 + 16.0 * unit[:, 0]
        return np.stack([x, low + (high - low) * s], axis=1)

    mesh = mapped("quad4", "plane_strain", (n, n), place)
    x, y = mesh.points.T
    right = mesh.faces_at(x > 48.0 - 1e-9)
    loads = no_loads(mesh).hold(x == 0.0, 0).hold(x == 0.0, 1)
    loads = loads.pull(traction(mesh, right, [0.0, 100.0 / 16.0]))
    done = solve(make_part(mesh, neo_hooke(80.194, bulk), loads, is_averaged))
    assert done.status == "solved", done.cause
    return done.last.u[np.argmax(x + y), 1]


BEAM = material_from_dict(
    {"kind": "st_venant_kirchhoff", "source": "a test", "youngs_modulus_pa": 1.0, "poisson_ratio": 0.0}
)
# Deflection over length of a cantilever with a force across its end, by P L^2 / EI: elliptic integrals.
ELASTICA = {1: 0.30172, 2: 0.49346, 5: 0.71379, 10: 0.81061}


def cantilever(length, height, n):
    mesh = block("quad8", "plane_strain", (n, 1), (length, height))
    x = mesh.points[:, 0]
    end = mesh.faces_at(x > length - 1e-9)
    return mesh, end, no_loads(mesh).hold(x == 0.0, 0).hold(x == 0.0, 1)


def elastica():
    """A cantilever of L/h = 100 under a force across its end: part, node there, deflections over length."""
    length, height = 1.0, 0.01
    mesh, end, loads = cantilever(length, height, 40)
    force = 10.0 * height**3 / 12.0 / length**2
    part = make_part(mesh, BEAM, loads.pull(traction(mesh, end, [0.0, force / height])))
    done = solve(part, [load / 10 for load in ELASTICA], SolverSettings(first_step=0.05, iterations=25))
    assert done.status == "solved", done.cause
    tip = np.argmax(mesh.points[:, 0] - np.abs(mesh.points[:, 1] - height / 2))
    return part, tip, np.array([state.u[tip, 1] for state in done.states]) / length


def euler_load():
    """Load at which the least eigenvalue of the stiffness of a column of L/h = 50 is 0, over Euler's."""
    length, height = 50.0, 1.0
    mesh, end, loads = cantilever(length, height, 25)
    euler = np.pi**2 * height**3 / 12.0 / (4 * length**2)
    part = make_part(mesh, BEAM, loads.pull(traction(mesh, end, [-euler / height, 0.0])))
    free = ~np.isfinite(part.loads.held).ravel()

    def least(load):
        state = solve(part, [load]).last
        K = part.stiffness(state.u, load)[free][:, free].tocsc()
        inverse = LinearOperator(K.shape, factorised(K).solve, dtype=float)
        return eigsh(K, k=1, sigma=0.0, OPinv=inverse, v0=np.ones(len(K.indptr) - 1))[0][0]

    return brentq(least, 0.9, 1.1, xtol=1e-5)
