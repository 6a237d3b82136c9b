"""Areas that grow up to a bound, and pressures within a dead band."""

import numpy as np
import pytest
from differences import extrapolated, worst
from test_model_chambers import differences, pressure_stiffness, robot, state

from soro_core import SoftArm
from soro_core.errors import ModelError
from soro_core.integrate import simulate
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.pneumatics import ValveModel

FIELDS = ({"basis": "legendre", "order": 3}, {"basis": "constant"})
BAND = 2400.0
SWELL = 1e-5
PRESSURE = np.array([1e4, -6e3, 2e3])


def arm_with(field=FIELDS[1], slope=3.0, **keys):
    plain = robot(field, slope)
    link = plain.links[0]
    chambers = [{**c.model_dump(exclude_none=True), **keys} for c in link.chambers]
    return SoftArm(plain.replace(links=[{**link.model_dump(exclude_none=True), "chambers": chambers}]))


def check_derivatives(arm, pressure):
    """Actuation matrix and stiffness by pressure are derivatives of the volumes, by differences."""
    q = state(arm)
    H = arm.actuation_matrix(q)
    scale = np.abs(H).max(axis=1)[:, None]
    np.testing.assert_allclose(differences(arm.displaced_volume, q) / scale, H / scale, atol=1e-7)
    K = np.zeros((arm.n_q, arm.n_q))
    pressure_stiffness(arm.tables, q, pressure, K)
    slopes = -differences(lambda x: arm.actuation_matrix(x) @ pressure, q)
    weight = np.sqrt(np.abs(np.diag(arm.stiffness_matrix(q))))
    each = np.outer(weight, weight)
    np.testing.assert_allclose(K / each, slopes / each, atol=1e-7 * np.abs(K / each).max())


@pytest.mark.slow
@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field["basis"])
@pytest.mark.parametrize(("slope", "saturation"), [(4.0, 0.4), (-4.0, 0.05), (20.0, 0.9)])
def test_volume_force_and_stiffness_of_a_bounded_area_are_derivatives(field, slope, saturation):
    check_derivatives(arm_with(field, slope, area_saturation=saturation), PRESSURE)


def growth(arm, strain):
    """Area over that at rest, at a constant elongation."""
    q = np.array([strain, 0.0, 0.0])
    return arm.actuation_matrix(q)[0, 0] / arm.actuation_matrix()[0, 0]


def test_an_area_begins_with_its_slope_and_ends_at_its_bound():
    arm = arm_with(slope=5.0, area_saturation=0.25)
    assert (growth(arm, 1e-5) - growth(arm, -1e-5)) / 2e-5 == pytest.approx(5.0, rel=1e-6)
    strains = (-0.9, -0.3, 0.0, 0.3, 0.9, 3.0, 200.0)
    areas = [growth(arm, strain) for strain in strains]
    assert (np.diff(areas[:-1]) > 0.0).all()
    assert areas[0] > 0.0
    assert areas[-1] == pytest.approx(4.0, rel=1e-12)
    # Far out the volume grows by four times that of a constant area.
    far = [arm.displaced_volume([strain, 0.0, 0.0])[0] for strain in (200.0, 201.0)]
    assert far[1] - far[0] == pytest.approx(4.0 * arm.actuation_matrix()[0, 0], rel=1e-9)


def test_without_a_bound_it_is_the_exponential():
    exponential, tiny = arm_with(slope=4.0), arm_with(slope=4.0, area_saturation=1e-9)
    q = np.array([0.2, 5.0, -3.0])
    assert growth(exponential, 0.2) == pytest.approx(np.exp(0.8), rel=1e-12)
    np.testing.assert_allclose(tiny.displaced_volume(q), exponential.displaced_volume(q), rtol=1e-7)
    np.testing.assert_allclose(tiny.actuation_matrix(q), exponential.actuation_matrix(q), rtol=1e-7)


def test_a_pressure_acts_beyond_the_dead_band():
    arm, plain = arm_with(dead_band_pa=BAND, area_saturation=0.3), arm_with(area_saturation=0.3)
    q = np.array([0.05, 5.0, -3.0])
    acting = np.array([1e4 - BAND, -6e3 + BAND, 0.0])
    np.testing.assert_allclose(arm.acting_pressure(PRESSURE), acting)
    found = [a.forward_dynamics(q, 0.1 * q, p) for a, p in ((arm, PRESSURE), (plain, acting))]
    np.testing.assert_allclose(*found, rtol=1e-12)
    np.testing.assert_allclose(
        arm.pressure_force(q, PRESSURE), plain.actuation_matrix(q) @ acting, rtol=1e-12
    )
    np.testing.assert_allclose(equilibrium(arm, PRESSURE), equilibrium(plain, acting), atol=1e-9)


def test_a_pressure_swells_the_area_that_it_acts_on():
    arm, plain = arm_with(dead_band_pa=BAND, swell_per_pa=SWELL), arm_with()
    q, beyond = np.array([0.05, 5.0, -3.0]), np.array([1e4 - BAND, -6e3 + BAND, 0.0])
    acting = beyond / (1.0 - SWELL * np.abs(beyond))
    np.testing.assert_allclose(arm.acting_pressure(PRESSURE), acting)
    found = [a.forward_dynamics(q, 0.1 * q, p) for a, p in ((arm, PRESSURE), (plain, acting))]
    np.testing.assert_allclose(*found, rtol=1e-12)
    np.testing.assert_allclose(equilibrium(arm, PRESSURE), equilibrium(plain, acting), atol=1e-9)


def test_a_pressure_beyond_the_pole_is_refused_with_its_name():
    arm, q = arm_with(dead_band_pa=BAND, swell_per_pa=SWELL), np.zeros(3)
    beyond = np.array([0.0, 1.01 * (BAND + 1.0 / SWELL), 0.0])
    for call in (arm.acting_pressure, lambda p: arm.forward_dynamics(q, q, p)):
        with pytest.raises(ModelError, match="chamber1") as caught:
            call(beyond)
        assert caught.value.key == "p"


@pytest.mark.slow
@pytest.mark.parametrize("swell", [0.0, SWELL])
def test_derivatives_with_a_dead_band_and_a_bounded_area(swell):
    arm = arm_with(dead_band_pa=BAND, area_saturation=0.3, swell_per_pa=swell)
    q, qd = np.array([0.05, 5.0, -3.0]), np.array([0.1, -3.0, 2.0])
    got = arm.derivatives(q, qd, PRESSURE)
    by_q = extrapolated(lambda x: arm.forward_dynamics(x, qd, PRESSURE), q, np.array([0.02, 1.0, 1.0]))
    # Steps that stay on one side of the kink.
    by_p = extrapolated(lambda p: arm.forward_dynamics(q, qd, p), PRESSURE, np.full(3, 300.0))
    assert worst(got.by_q, by_q) < 1e-8
    assert worst(got.by_p, by_p) < 1e-8
    assert not got.by_p[:, 2].any()


def test_no_energy_is_gained_from_a_bounded_area_behind_a_dead_band():
    """Kinetic, elastic and gravitational energy less what the pressures give: it never grows."""
    arm = arm_with(slope=6.0, dead_band_pa=BAND, area_saturation=0.4)
    q0 = np.array([0.05, 6.0, -4.0])
    run = simulate(arm, q0, np.zeros(3), t_end=0.4, dt=2e-3, integrator="tr_bdf2", pressure=PRESSURE)
    assert run.status.ok
    stored = [
        sum(arm.energy(q, qd)) - arm.acting_pressure(PRESSURE) @ arm.displaced_volume(q)
        for q, qd in zip(run.q, run.qd, strict=True)
    ]
    kinetic = max(arm.energy(q, qd)[0] for q, qd in zip(run.q, run.qd, strict=True))
    assert kinetic > 1e-3 * np.ptp(stored)
    assert max(np.diff(stored)) <= 1e-10 * kinetic


@pytest.mark.parametrize("law", [{"dead_band_pa": 2e3}, {"swell_per_pa": SWELL}])
def test_air_behind_valves_refuses_pressures_that_do_not_act_as_they_are(law):
    arm = arm_with(**law)
    with pytest.raises(ModelError) as caught:
        simulate(arm, np.zeros(3), t_end=0.01, dt=1e-3, pressure=PRESSURE, valves=ValveModel())
    assert caught.value.key == "link0/chamber0"
