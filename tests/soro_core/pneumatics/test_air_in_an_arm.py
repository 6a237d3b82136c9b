"""Air in the chambers of an arm: volume, pressure and motion move each other."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm, simulate
from soro_core.errors import ModelError
from soro_core.pneumatics import ValveModel
from soro_core.pneumatics.chamber import AMBIENT_PA
from tests.apparatus.extremes.arms import Arm
from tests.refused import fails

SHUT = ValveModel(fill_m3_s_pa=0.0, vent_m3_s_pa=0.0)
# Soft enough for the air to matter: it is about as stiff as the links.
SOFT = Arm(links=2, youngs_modulus=5e4, area_slope=-2.0)
PRESSURE0 = np.array([30e3, 0.0, 10e3, 0.0, 20e3, 5e3])


def air_energy(pressure, volume, n):
    """Energy of closed air and of the air outside [J], by row; of the pressures and volumes at each."""
    absolute = pressure + AMBIENT_PA
    inside = -absolute * volume * np.log(volume) if n == 1.0 else absolute * volume / (n - 1.0)
    return (inside + AMBIENT_PA * volume).sum(axis=1)


def volumes(arm, result):
    rest = arm.tables.axial_gain.sum(axis=0)
    return rest + np.array([arm.displaced_volume(q) for q in result.q])


def total_energy(arm, result, n):
    own = np.array([sum(arm.energy(q, qd)) for q, qd in zip(result.q, result.qd, strict=True)])
    return own + air_energy(result.pressure, volumes(arm, result), n)


def closed(n, losses=0.0, integrator="midpoint", dt=5e-4):
    arm = SoftArm(replace(SOFT, loss_s=losses).robot())
    q0 = SOFT.coordinates(arm.robot, 8.0, 0.05)
    valves = SHUT.model_copy(update={"polytropic": n})
    result = simulate(
        arm,
        q0,
        t_end=1.0,
        dt=dt,
        integrator=integrator,
        valves=valves,
        pressure0=PRESSURE0,
        pressure=np.full(6, 9e4),
    )
    assert result.status == "ok"
    return arm, result


def test_volumes_have_the_actuation_as_their_gradient():
    arm = SoftArm(SOFT.robot())
    q = SOFT.coordinates(arm.robot, 8.0, 0.1)
    h = 1e-6
    rows = [
        (arm.displaced_volume(q + e) - arm.displaced_volume(q - e)) / (2 * h) for e in h * np.eye(arm.n_q)
    ]
    assert np.array(rows) == pytest.approx(arm.actuation_matrix(q), rel=1e-6, abs=1e-13)


@pytest.mark.parametrize("n", [1.0, 1.4])
def test_shut_chambers_keep_p_v_and_the_energy(n):
    arm, result = closed(n)
    product = (result.pressure + AMBIENT_PA) * volumes(arm, result) ** n
    assert np.ptp(product, axis=0) == pytest.approx(0.0, abs=1e-12 * product.max())
    assert np.ptp(result.pressure, axis=0).min() > 2e3
    energy = total_energy(arm, result, n)
    kinetic = max(arm.energy(q, qd)[0] for q, qd in zip(result.q, result.qd, strict=True))
    swing = np.ptp(energy) / kinetic
    assert swing < 2e-3
    # Second order: a swing of the method, not a leak.
    arm, result = closed(n, dt=2.5e-4)
    assert np.ptp(total_energy(arm, result, n)) / kinetic < 0.3 * swing


def test_with_losses_the_energy_of_arm_and_air_falls():
    arm, result = closed(1.0, losses=0.005, integrator="tr_bdf2")
    energy = total_energy(arm, result, 1.0)
    assert np.diff(energy).max() <= 1e-9 * np.ptp(energy)
    assert energy[-1] < energy[0] - 0.1 * np.ptp(energy)


def test_shut_chambers_stiffen_the_arm():
    """Elongation of one link: k = E A / L + sum of p_abs A_i^2 / V_i, by the frequency of a small swing."""
    link = Arm(links=1, youngs_modulus=5e4)
    arm = SoftArm(link.robot().replace(gravity=(0.0, 0.0, 0.0)))
    gain = arm.tables.axial_gain.sum(axis=0)
    stiffness = arm.stiffness_matrix(np.zeros(3))[0, 0] + (AMBIENT_PA * gain**2 / gain).sum()
    expected = np.sqrt(stiffness / arm.inertia_matrix(np.zeros(3))[0, 0])
    result = simulate(arm, [1e-4, 0.0, 0.0], t_end=0.2, dt=1e-4, integrator="midpoint", valves=SHUT)
    crossings = result.t[:-1][np.diff(np.sign(result.q[:, 0])) != 0]
    measured = np.pi / np.diff(crossings).mean()
    assert measured == pytest.approx(expected, rel=2e-3)
    assert expected > 1.2 * np.sqrt(
        arm.stiffness_matrix(np.zeros(3))[0, 0] / arm.inertia_matrix(np.zeros(3))[0, 0]
    )


def test_the_valves_bring_the_arm_to_where_given_pressures_do():
    link = replace(SOFT, youngs_modulus=3e5, loss_s=0.02)
    arm = SoftArm(link.robot())
    setpoint = np.array([60e3, 10e3, 20e3, 10e3, 40e3, 10e3])
    slow = ValveModel(fill_m3_s_pa=2e-12, vent_m3_s_pa=2e-12)
    given = simulate(arm, t_end=4.0, dt=5e-3, integrator="tr_bdf2", pressure=setpoint)
    through = simulate(arm, t_end=4.0, dt=5e-3, integrator="tr_bdf2", pressure=setpoint, valves=slow)
    assert through.status == given.status == "ok"
    assert through.pressure[-1] == pytest.approx(setpoint, abs=1.0)
    assert through.q[-1] == pytest.approx(given.q[-1], abs=1e-5 * np.abs(given.q[-1]).max())
    # It takes its time: the highest pressure is on its way for a while.
    assert 0.0 < through.pressure[4, 0] < 0.9 * setpoint[0]


@pytest.mark.parametrize("refine", [1, 4])
@pytest.mark.parametrize("volume", [None, 1e-9, 1e-3])
def test_any_volume_at_20_ms(refine, volume):
    """Tiny and huge volumes, chambers along one link and along four, a supply of 5 bar on a soft arm."""
    robot = replace(SOFT, loss_s=0.01).robot()
    if volume is not None:
        links = [link.model_dump(exclude_unset=True) for link in robot.links]
        for link in links:
            # Beyond what the arm displaces, so that no chamber can close.
            own = 0.1 * np.pi * 0.005**2 * 0.05
            link["chambers"] = [{**chamber, "volume_m3": own + volume} for chamber in link["chambers"]]
        robot = robot.replace(links=links)
    arm = SoftArm(robot.refine(refine))
    valves = ValveModel(fill_m3_s_pa=1e-8, vent_m3_s_pa=1e-8, supply_pa=500e3)

    def steps(t):
        return 20e3 * np.arange(6) * (int(t / 0.2) % 2)

    result = simulate(arm, t_end=1.0, dt=20e-3, integrator="tr_bdf2", pressure=steps, valves=valves)
    assert result.status == "ok"
    assert np.isfinite(result.q).all()
    assert result.pressure.min() > -AMBIENT_PA
    assert result.pressure.max() < 510e3


def test_what_is_not_allowed_is_said():
    arm = SoftArm(SOFT.robot())
    with fails(ModelError, "dopri5", "tr_bdf2", key="integrator"):
        simulate(arm, integrator="dopri5", valves=SHUT)
    with fails(ModelError, "valves", key="pressure0"):
        simulate(arm, pressure0=np.zeros(6))
    with fails(ModelError, "-101325 Pa", key="pressure0"):
        simulate(arm, pressure0=np.full(6, -2e5), valves=SHUT)
    with fails(ModelError, "m^3", key="q0"):
        simulate(arm, SOFT.coordinates(arm.robot, 900.0), valves=SHUT)
    spec = arm.robot.links[0].model_dump(exclude_unset=True)
    spec["chambers"] = [{"angle_rad": 0.0, "alpha_eps": 0.0, "alpha_kappa": 1e-9}]
    with fails(ModelError, "volume_m3", key="link0/chamber0"):
        simulate(SoftArm(arm.robot.replace(links=[spec])), valves=SHUT)
