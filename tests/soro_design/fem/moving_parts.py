"""Parts that snap, swing, ring and fold, with closed forms where there are any; for tests and benchmarks."""

import numpy as np
from scipy.special import ellipk

from soro_design.fem.elements.material import material_from_dict
from soro_design.fem.loads import no_loads, traction
from soro_design.fem.meshes.bellows import Bellows, bellows_mesh
from soro_design.fem.meshes.blocks import block, mapped, sphere
from soro_design.fem.part import make_part
from soro_design.fem.solve.arc import follow
from soro_design.fem.solve.dynamics import march
from soro_design.fem.solve.mass import modes
from soro_design.fem.solve.newton import solve
from soro_design.fem.solve.states import SolverSettings

E, DENSITY = 1e6, 1000.0
BEAM = material_from_dict(
    {
        "kind": "st_venant_kirchhoff",
        "source": "a test",
        "youngs_modulus_pa": E,
        "poisson_ratio": 0.0,
        "density_kg_per_m3": DENSITY,
    }
)
SOFT = material_from_dict({"kind": "hyperelastic", "source": "a test", "c1_pa": 2e4, "poisson_ratio": 0.49})
# mu = 1 Pa, K = 1e4 Pa
RUBBER = material_from_dict(
    {"kind": "hyperelastic", "source": "a test", "c1_pa": 0.5, "poisson_ratio": 29998 / 60002}
)


def balloon(pressure):
    mesh = sphere("quad4", (4, 12), (1.0, 1.2))
    r, z = mesh.points.T
    inside = mesh.faces_at(np.abs(np.hypot(r, z) - 1.0) < 1e-9)
    loads = no_loads(mesh).hold(z == 0.0, 1).press(inside, pressure)
    return make_part(mesh, RUBBER, loads), int(np.flatnonzero((z == 0.0) & (r == 1.0))[0])


def pressure_of(stretch):
    """Pressure over mu in an incompressible sphere of radii 1 and 1.2: p = s(outer) - s(inner)."""
    outer = np.cbrt((stretch**3 - 1.0) / 1.2**3 + 1.0)
    one, other = (2.0 / x + 0.5 / x**4 for x in (outer, stretch))
    return one - other


def inflated():
    """Stretches and pressures over mu along the path of the balloon up to a stretch of 3."""
    part, at = balloon(1.0)
    done = follow(part, until=lambda state: state.u[at, 0] > 2.0)
    assert done.status == "solved", done.cause
    states = done.states
    return np.array([1.0 + state.u[at, 0] for state in states]), np.array([state.load for state in states])


# Half of a clamped arch y = a (1 + cos k x) / 2 of thickness t, k = 2 pi; no effect of Poisson's.
RISE, THICKNESS, K = 0.015, 0.005, 2.0 * np.pi


def arch():
    """The arch under a pressure p cos k x across it, downwards at the crown."""

    def place(unit):
        x, s = 0.5 * unit[:, 0], unit[:, 1] - 0.5
        y, slope = 0.5 * RISE * (1.0 + np.cos(K * x)), -0.5 * RISE * K * np.sin(K * x)
        across = np.stack([-slope, np.ones_like(slope)], axis=1) / np.hypot(1.0, slope)[:, None]
        return np.stack([x, y], axis=1) + THICKNESS * s[:, None] * across

    mesh = mapped("quad8", "plane_strain", (16, 1), place)
    x, y = mesh.points.T
    end = x > 0.5 - 1e-9
    top = mesh.faces_at(y > 0.5 * RISE * (1.0 + np.cos(K * x)) + 0.4 * THICKNESS)
    force = traction(mesh, top, [0.0, -1.0])
    force[:, 1] *= np.cos(K * x)
    loads = no_loads(mesh).hold(x < 1e-9, 0).hold(end, 0).hold(end, 1).pull(force)
    return mesh, loads, np.flatnonzero(x < 1e-9)


def shallow(rise):
    """Load of the shallow arch at a rise of its crown: EI y'''' - N y'' of one cosine, which is exact."""
    axial = (rise**2 - RISE**2) * K**2 / 16.0
    bending = 0.5 * K**4 * E * THICKNESS**3 / 12.0 * (RISE - rise)
    return bending - 0.5 * K**2 * E * THICKNESS * axial * rise


def snapped():
    """The arch under 2.5 times its limit load: part, path, rises of its crown and loads on it, limit load."""
    mesh, loads, crown = arch()
    limits = shallow(np.linspace(RISE, -RISE, 4001))
    peak = limits[: np.argmax(np.diff(limits) < 0) + 1][-1]
    part = make_part(mesh, BEAM, loads.pull((2.5 * peak - 1.0) * loads.force))
    done = follow(part, settings=SolverSettings(first_step=0.05))
    assert done.status == "solved", done.cause
    rise = np.array([RISE + state.u[crown, 1].mean() for state in done.states])
    return part, done, rise, 2.5 * peak * np.array([state.load for state in done.states]), peak


# Roots of cos x cosh x = -1: lengths of a cantilever over its wave numbers.
ROOTS = np.array([1.87510407, 4.69409113, 7.85475744])


def cantilever_modes(kind, counts, slenderness):
    """A cantilever of length 1: part, first three modes, and the frequencies of Euler and Bernoulli [Hz]."""
    d, height = len(counts), 1.0 / slenderness
    mesh = block(kind, "solid" if d == 3 else "plane_strain", counts, (1.0, height, 2 * height)[:d])
    loads = no_loads(mesh)
    for k in range(d):
        loads = loads.hold(mesh.points[:, 0] == 0.0, k)
    if d == 3:
        loads = loads.hold(mesh.points[:, 0] >= 0.0, 2)
    part = make_part(mesh, BEAM, loads)
    expected = ROOTS**2 * np.sqrt(E * height**2 / 12.0 / DENSITY) / (2 * np.pi)
    return part, modes(part, count=3), expected


def pinned(load):
    """Half of a pinned beam of length 1 and thickness .01 under its Euler load times `load`, compressed."""
    height = 0.01
    mesh = block("quad8", "plane_strain", (16, 1), (0.5, height))
    x = mesh.points[:, 0]
    loads = no_loads(mesh).hold(x == 0.0, 0).hold(x > 0.5 - 1e-9, 1)
    euler = np.pi**2 * E * height**3 / 12.0
    end = mesh.faces_at(x > 0.5 - 1e-9)
    part = make_part(mesh, BEAM, loads.pull(traction(mesh, end, [-euler / height, 0.0])))
    pulled = part.under(loads.pull(np.sign(load) * part.loads.force))
    return pulled, solve(pulled, [abs(load)]).last if load else None


def crossings(time, value):
    """Times at which a value passes 0, by straight lines."""
    at = np.flatnonzero(value[:-1] * value[1:] < 0.0)
    return time[at] - value[at] * (time[at + 1] - time[at]) / (value[at + 1] - value[at])


def pendulum():
    """A block pinned at its upper edge swings from 80 degrees: period over its closed form, and drift.

    The drift is that of the energy, over the greatest kinetic one.
    """
    width, height, gravity, angle = 0.1, 0.4, 9.81, np.deg2rad(80.0)
    mesh = block("quad8", "plane_strain", (1, 2), (width, height))
    pin = int(np.flatnonzero((mesh.points == [width / 2, height]).all(axis=1))[0])
    loads = no_loads(mesh).hold([pin], 0).hold([pin], 1)
    part = make_part(mesh, BEAM.model_copy(update={"youngs_modulus_pa": 1e9}), loads)
    weight = part.weight([0.0, -gravity])
    part = part.under(loads.pull(weight))
    arm = mesh.points - mesh.points[pin]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    # I / (m g d) about the pin
    inertia = (width**2 + height**2) / 12.0 + height**2 / 4.0
    period = 4.0 * np.sqrt(inertia / (gravity * height / 2.0)) * ellipk(np.sin(angle / 2.0) ** 2)
    done = march(part, period / 160, 250, u=arm @ turn.T - arm, rho_inf=0.9)
    assert done.status == "solved", done.cause
    time = np.array([state.time_s for state in done.states])
    low = int(np.flatnonzero((mesh.points == [width / 2, 0.0]).all(axis=1))[0])
    found = 2.0 * np.diff(crossings(time, np.array([arm[low, 0] + state.u[low, 0] for state in done.states])))
    energy = [state.strain_energy + state.kinetic_energy - (weight * state.u).sum() for state in done.states]
    return found[-1] / period, np.ptp(energy) / max(state.kinetic_energy for state in done.states)


def folded(contact):
    """One lobe of soft bellows under vacuum, ends in planes of symmetry: its walls close on each other."""
    shape = Bellows(1, 6.975e-3, 4.3e-3, 12.6e-3, 3.6e-3, 1.1e-3, 0.8e-3)
    mesh = bellows_mesh("quad4", shape, 2, (3, 6, 3, 2))
    z = mesh.points[:, 1]
    rows = np.arange(len(z)).reshape(3, -1)
    inside = np.isin(np.arange(len(z)), rows[0])
    ends = (z < 1e-9) | (z > z.max() - 1e-9)
    loads = no_loads(mesh).hold(ends, 1).press(mesh.faces_at(inside), -800.0)
    part = make_part(mesh, SOFT, loads, contact=contact)
    done = solve(part, np.linspace(0.1, 1.0, 10))
    assert done.status == "solved", done.cause
    r, height = (mesh.points + [state.u for state in done.states])[:, rows[0]].transpose(2, 0, 1)
    # Volume inside, of cones between neighbours.
    area = np.pi / 3 * (r[:, 1:] ** 2 + r[:, 1:] * r[:, :-1] + r[:, :-1] ** 2)
    return done, np.abs((area * np.diff(height, axis=1)).sum(axis=1)), part
