"""Loads beyond a limit point: a balloon and a shallow arch by arc length, against closed forms."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.fem.arc import follow
from soro_core.fem.blocks import block, mapped, sphere
from soro_core.fem.loads import no_loads, traction
from soro_core.fem.material import material_from_dict
from soro_core.fem.newton import solve
from soro_core.fem.part import make_part
from soro_core.fem.states import Settings
from tests.refused import fails

# mu = 1 Pa, K = 1e4 Pa
RUBBER = material_from_dict(
    {"kind": "hyperelastic", "source": "a test", "c1_pa": 0.5, "poisson_ratio": 29998 / 60002}
)
BEAM = material_from_dict(
    {"kind": "st_venant_kirchhoff", "source": "a test", "youngs_modulus_pa": 1.0, "poisson_ratio": 0.0}
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


def test_a_balloon_is_followed_past_its_greatest_pressure(figure):
    part, at = balloon(1.0)
    done = follow(part, until=lambda state: state.u[at, 0] > 2.0)
    assert done.status == "solved", done.cause
    stretch = np.array([1.0 + state.u[at, 0] for state in done.states])
    load = np.array([state.load for state in done.states])
    off = load / pressure_of(stretch) - 1.0
    figure(
        f"balloon: {len(load)} steps, pressure off by {np.abs(off).max():.2e}; greatest {load.max():.4f} mu"
    )
    assert np.abs(off).max() < 5e-3
    # Past the limit, and well down.
    fine = pressure_of(np.linspace(1.0, 3.0, 2001))
    assert load.max() == pytest.approx(fine.max(), rel=5e-3)
    assert load[-1] < 0.75 * load.max()
    assert (np.diff(stretch) > 0).all()


def test_load_control_names_the_limit_point_and_keeps_the_last_state():
    part, _ = balloon(1.0)
    limit = pressure_of(np.linspace(1.0, 3.0, 2001)).max()
    done = solve(part, (0.1, 1.0))
    assert done.status == "stopped"
    assert "limit point" in done.cause
    assert "follow" in done.cause
    assert [state.load for state in done.states] == [0.1]
    named = float(done.cause.split("limit point at load factor ")[1].split(",")[0])
    assert named == pytest.approx(limit, rel=5e-3)
    assert done.last.load == pytest.approx(named, rel=1e-2)
    assert done.last.load <= named


def test_a_cause_that_is_no_limit_point_is_not_called_one():
    mesh = block("quad4", "plane_strain", (1, 1), (1.0, 1.0))
    loads = no_loads(mesh).hold(mesh.points[:, 0] >= 0.0, 0).hold(mesh.points[:, 1] == 0.0, 1)
    done = solve(make_part(mesh, RUBBER, loads.hold(mesh.points[:, 1] == 1.0, 1, -1.2)))
    assert "limit point" not in done.cause


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
    return 0.5 * K**4 * THICKNESS**3 / 12.0 * (RISE - rise) - 0.5 * K**2 * THICKNESS * axial * rise


def test_a_shallow_arch_snaps_through(figure):
    mesh, loads, crown = arch()
    limits = shallow(np.linspace(RISE, -RISE, 4001))
    peak = limits[: np.argmax(np.diff(limits) < 0) + 1][-1]
    part = make_part(mesh, BEAM, loads.pull((2.5 * peak - 1.0) * loads.force))
    done = follow(part, settings=Settings(first_step=0.05))
    assert done.status == "solved", done.cause
    assert done.last.load == 1.0
    rise = np.array([RISE + state.u[crown, 1].mean() for state in done.states])
    load = 2.5 * peak * np.array([state.load for state in done.states])
    off = np.abs(load - shallow(rise)).max() / peak
    figure(
        f"shallow arch: {len(load)} steps, off by {off:.1e} of the limit load {peak:.4g} Pa;"
        f" limits {load[: np.argmin(rise > 0)].max() / peak:.4f} and {load.min() / peak:.4f} of it"
    )
    assert off < 5e-3
    # Up, down below 0, and up again on the other side.
    turns = np.flatnonzero(np.diff(np.sign(np.diff(load))))
    assert len(turns) == 2
    assert load[turns[1] + 1] < 0.0
    assert rise[-1] < -RISE
    # Load control jumps across; beyond, it finds the same state.
    jumped = solve(part)
    assert jumped.status == "solved"
    np.testing.assert_allclose(jumped.last.u, done.last.u, atol=1e-8 * RISE)


def test_what_is_refused():
    part, _ = balloon(1.0)
    for arguments in ({"load": 0.0}, {"load": float("nan")}, {"most_steps": 0}):
        with fails(ModelError, key="load"):
            follow(part, **arguments)


def test_a_path_that_is_too_long_stops_with_a_cause():
    part, _ = balloon(1.0)
    done = follow(part, most_steps=3)
    assert (done.status, done.steps, len(done.states)) == ("stopped", 3, 3)
    assert "3 steps" in done.cause


def test_prescribed_displacements_are_followed_too():
    """A block that is pulled has no limit: the path is that of load control."""
    mesh = block("quad4", "plane_strain", (2, 2), (1.0, 1.0))
    loads = no_loads(mesh).hold(mesh.points[:, 1] == 0.0, 1).hold(mesh.points[:, 0] == 0.0, 0)
    part = make_part(mesh, RUBBER, loads.hold(mesh.points[:, 1] == 1.0, 1, 0.5))
    found, expected = follow(part).last, solve(part).last
    np.testing.assert_allclose(found.u, expected.u, atol=1e-8)
    np.testing.assert_allclose(found.reaction, expected.reaction, atol=1e-7)
