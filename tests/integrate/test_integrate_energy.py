"""Energy of an arm without damping and input: kept by the midpoint rule, hardly gained by the dissipative."""

import numpy as np
import pytest
from rods import IMPLICIT, LENGTH, bent, energies, rod, scale

from soro_core import simulate

DISSIPATIVE = ("tr_bdf2", "tr_bdf2_linear")


@pytest.mark.parametrize("dt", [2e-3, 5e-3])
def test_midpoint_keeps_energy_for_a_minute(dt, figure):
    """Bounded, and no trend: a straight line fitted to the energy explains nothing of it."""
    arm = rod(2, youngs_modulus=1e5, viscosity=0.0)
    result = simulate(arm, bent(arm), t_end=60.0, dt=dt, integrator="midpoint")
    assert result.status.ok
    y = (energies(arm, result, 3000) - sum(arm.energy(result.q[0], result.qd[0]))) / scale(arm, result)
    t = np.linspace(0.0, 60.0, len(y))
    slope = np.polyfit(t, y, 1)[0]
    figure(
        f"midpoint, 60 s, dt {dt:g} s: energy within {np.ptp(y):.1e} of the start's, "
        f"trend {slope * 60:+.1e}, scatter {y.std():.1e}"
    )
    assert np.ptp(y) < 60.0 * dt**2
    assert abs(slope) * 60.0 < 0.1 * y.std()


@pytest.mark.parametrize("name", DISSIPATIVE)
@pytest.mark.parametrize(
    ("youngs_modulus", "dt"), [(1e4, 5e-3), (1e6, 1e-3), (1e6, 5e-3), (1e8, 5e-3), (1e8, 2e-2)]
)
def test_dissipative_steppers_gain_less_than_a_thousandth(name, youngs_modulus, dt):
    """Not beyond the start, nor ever beyond what there was a quarter of a run before."""
    arm = rod(4, youngs_modulus, viscosity=0.0)
    result = simulate(arm, bent(arm), t_end=200 * dt, dt=dt, integrator=name)
    assert result.status.ok
    y = energies(arm, result) / scale(arm, result)
    assert y.max() <= y[0] + 1e-3
    quarters = [part.max() for part in np.array_split(y, 4)]
    assert (np.diff(quarters) < 1e-3).all()


@pytest.mark.parametrize("name", DISSIPATIVE)
@pytest.mark.parametrize(("n_links", "youngs_modulus"), [(1, 1e8), (4, 1e6), (4, 1e8)])
def test_loops_let_go_gain_no_energy(name, n_links, youngs_modulus):
    """A full turn in each link: far from small motion, which is all that linear damping knows of."""
    arm = rod(n_links, youngs_modulus, viscosity=0.0, radius=0.01 / n_links)
    q0 = np.tile([0.0, 1.0, 0.2], n_links) * 2.0 * np.pi * n_links / LENGTH
    result = simulate(arm, q0, t_end=0.1, dt=5e-3, integrator=name)
    assert result.status == "ok"
    y = energies(arm, result) / scale(arm, result)
    assert y.max() <= y[0] + (2e-2 if name == "tr_bdf2_linear" else 1e-3)


@pytest.mark.parametrize("name", IMPLICIT)
@pytest.mark.parametrize("n_links", [1, 4, 16])
@pytest.mark.parametrize("viscosity", [0.0, 300.0])
def test_very_stiff_arms_finish_and_stay_physical(name, n_links, viscosity, figure):
    """E = 100 MPa, bent and let go: no step of 5 ms resolves it, and none may feed it."""
    arm = rod(n_links, 1e8, viscosity)
    result = simulate(arm, bent(arm), t_end=0.5, dt=5e-3, integrator=name)
    assert result.status == "ok"
    y = energies(arm, result) / scale(arm, result)
    if viscosity == 0.0 and n_links == 4:
        figure(f"{name}, E 100 MPa, 4 links, dt 5 ms: largest gain of energy {max(0.0, y.max() - y[0]):.0e}")
    assert y.max() <= y[0] + 1e-2


@pytest.mark.parametrize("name", IMPLICIT)
@pytest.mark.parametrize("dt", [1e-5, 1e-3, 2e-2])
def test_stiff_and_soft_at_any_step(name, dt):
    """From 10 us to 20 ms, where no method resolves the swing of the soft arm either."""
    for youngs_modulus in (1e4, 1e8):
        arm = rod(4, youngs_modulus, 0.0)
        result = simulate(arm, bent(arm), t_end=50 * dt, dt=dt, integrator=name)
        assert result.status == "ok"
        y = energies(arm, result) / scale(arm, result)
        assert y.max() <= y[0] + (5e-2 if dt == 2e-2 else 1e-2)
