"""Air in chambers: the orifice, conservation of mass, limits of fill and vent, any step and volume."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core._jit import kernel
from soro_core.pneumatics import ValveModel, chamber_pressures, healthy, inflows, make_gas, masses_at
from soro_core.pneumatics.chamber import AMBIENT_PA, GAS_CONSTANT
from soro_core.pneumatics.flow import REFERENCE_DENSITY, mass_flow

SETTINGS = settings(max_examples=200)
CLOSED = ValveModel(fill_m3_s_pa=0.0, vent_m3_s_pa=0.0)
# Opens fully at any deviation: a valve that is open or shut.
OPEN = ValveModel(band_pa=1.0)
V = 30e-6
C = 1e-9


@kernel
def orifice(conductance, critical, from_pa, to_pa):
    return mass_flow(conductance, critical, from_pa, to_pa)


class Chambers:
    """Chambers in time, in Python."""

    def __init__(self, model, volume, pressure=0.0):
        self.volume = np.atleast_1d(np.array(volume, dtype=float))
        self.gas = make_gas(model, self.volume)
        self.mass, self.pressure = np.empty_like(self.volume), np.full_like(self.volume, pressure)
        masses_at(self.gas, self.pressure, self.volume, self.mass)

    def step(self, setpoint, dt, volume=None):
        end = self.volume if volume is None else np.atleast_1d(np.array(volume, dtype=float))
        mass, pressure, slope = np.empty((3, len(end)))
        wanted = np.full(len(end), float(setpoint))
        good = chamber_pressures(self.gas, self.mass, self.volume, end, wanted, dt, mass, pressure, slope)
        assert good
        self.mass, self.pressure, self.volume = mass, pressure, end
        return pressure[0], slope[0]


def time_to(model, start, setpoint, level, dt, volume=V):
    """Time at which the pressure passes a level, between steps on a straight line."""
    chambers, t, before = Chambers(model, volume, start), 0.0, start
    while True:
        now, _ = chambers.step(setpoint, dt)
        if (now - level) * (start - level) <= 0.0:
            return t + dt * (level - before) / (now - before)
        t, before = t + dt, now


def test_the_orifice_is_choked_below_the_critical_ratio_and_still_at_equal_pressures():
    for b in (0.2, 0.35, 0.528):
        choked, by_high, by_low = orifice(C, b, 250e3, b * 250e3)
        assert choked == pytest.approx(C * REFERENCE_DENSITY * 250e3, rel=1e-14)
        assert (by_high, by_low) == (pytest.approx(choked / 250e3), 0.0)
        assert orifice(C, b, 250e3, 1e3)[0] == choked
        assert orifice(C, b, 2e5, 2e5)[0] == 0.0
        assert math.isfinite(orifice(C, b, 2e5, 2e5)[1])


def test_the_ellipse_between():
    r, b = 0.8, 0.35
    expected = C * REFERENCE_DENSITY * 250e3 * math.sqrt(1 - ((r - b) / (1 - b)) ** 2)
    assert orifice(C, b, 250e3, r * 250e3)[0] == pytest.approx(expected, rel=1e-14)


@SETTINGS
@given(st.floats(1e3, 1e6), st.floats(1e3, 1e6), st.floats(0.0, 0.9), st.floats(-2e-3, 2e-3))
def test_the_flow_turns_with_its_sign_and_grows_with_the_difference(high, low, b, near):
    for p1, p2 in ((high, low), (high, high * (1 + near))):
        flow, by_from, by_to = orifice(C, b, p1, p2)
        back = orifice(C, b, p2, p1)
        assert flow == -back[0]
        assert (by_from, by_to) == (-back[2], -back[1])
        assert flow * (p1 - p2) >= 0.0
        assert by_from >= 0.0
        assert by_to <= 0.0
        h = 1e-5 * p1
        # Across an edge of the pieces the difference quotient is only between the two slopes.
        ahead = (orifice(C, b, p1 + h, p2)[0] - flow) / h
        assert ahead >= -1e-12 * C
        assert abs(ahead) <= 1.001 * max(by_from, orifice(C, b, p1 + h, p2)[1]) + 1e-3 * C


def test_a_closed_chamber_keeps_its_mass_and_p_v():
    for n in (1.0, 1.4):
        chambers = Chambers(CLOSED.model_copy(update={"polytropic": n}), V, 20e3)
        mass = chambers.mass.copy()
        for volume in (20e-6, 45e-6, 3e-6, 30e-6):
            p, slope = chambers.step(90e3, 0.005, volume)
            assert chambers.mass == mass
            assert (p + AMBIENT_PA) * volume**n == pytest.approx((20e3 + AMBIENT_PA) * V**n, rel=1e-13)
            assert slope == pytest.approx(-n * (p + AMBIENT_PA) / volume, rel=1e-13)


def test_no_flow_at_the_set_point_and_none_at_equal_pressures():
    gas = make_gas(ValveModel(), np.full(3, V))
    flow = np.empty(3)
    inflows(gas, np.array([30e3, 150e3, 0.0]), np.array([30e3, 400e3, -50e3]), flow)
    assert (flow == 0.0).all()


def test_choked_filling_takes_its_closed_form():
    """While choked the pressure rises in a straight line, p' = C rho_0 p_supply R T / V."""
    model = OPEN.model_copy(update={"supply_pa": 600e3})
    rate = C * REFERENCE_DENSITY * (600e3 + AMBIENT_PA) * GAS_CONSTANT * 293.15 / V
    level = 0.35 * (600e3 + AMBIENT_PA) - AMBIENT_PA
    for dt in (1e-4, 1e-3, level / rate):
        assert time_to(model, 0.0, 600e3, level, dt) == pytest.approx(level / rate, rel=1e-8)


def test_unchoked_filling_takes_its_closed_form():
    """Beyond, x = (p / p_supply - b) / (1 - b) runs as a sine; second order in dt."""
    model = OPEN.model_copy(update={"supply_pa": 150e3})
    supply, b = 150e3 + AMBIENT_PA, 0.35
    omega = C * REFERENCE_DENSITY * GAS_CONSTANT * 293.15 / V / (1 - b)
    x = [(p / supply - b) / (1 - b) for p in (AMBIENT_PA, AMBIENT_PA + 31.6e3)]
    exact = (math.asin(x[1]) - math.asin(x[0])) / omega
    assert exact == pytest.approx(0.039, abs=5e-4)  # as in docs/hardware.md
    errors = [abs(time_to(model, 0.0, 150e3, 31.6e3, dt) - exact) for dt in (2e-3, 1e-3, 5e-4)]
    assert errors[0] < 2e-3 * exact
    assert errors[1] < 0.4 * errors[0]
    assert errors[2] < 0.4 * errors[1]


def test_choked_venting_takes_its_closed_form():
    """To a vacuum the pressure falls as an exponential."""
    model = OPEN.model_copy(update={"exhaust_pa": -101e3})
    decay = C * REFERENCE_DENSITY * GAS_CONSTANT * 293.15 / V
    exact = math.log((100e3 + AMBIENT_PA) / AMBIENT_PA) / decay
    assert time_to(model, 100e3, -101e3, 0.0, 1e-3) == pytest.approx(exact, rel=1e-4)


def test_venting_is_slower_than_filling():
    """By more than twice, at a supply of 150 kPa and 50 kPa in the chamber, as in docs/hardware.md."""
    t63 = 50e3 * (1 - math.exp(-1))
    fill = time_to(OPEN, 0.0, 50e3, t63, 1e-3)
    vent = time_to(OPEN, 50e3, 0.0, 50e3 - t63, 1e-3)
    assert vent > 2.0 * fill


def test_the_pressure_meets_its_goal_without_passing_it():
    """Tiny volumes and 20 ms: no chatter about the supply, the exhaust or the set point."""
    for volume in (1e-12, 1e-9, 1e-7, 1e-5):
        for model in (ValveModel(), OPEN, ValveModel(polytropic=1.4)):
            for start, setpoint, goal in ((0.0, 400e3, 150e3), (90e3, -1e4, 0.0), (0.0, 30e3, 30e3)):
                chambers, before = Chambers(model, volume, start), start
                for _ in range(400):
                    p, _ = chambers.step(setpoint, 0.02)
                    sign = 1.0 if goal > start else -1.0
                    assert sign * (p - before) >= -1e-7
                    assert sign * (goal - p) >= -1e-7
                    before = p
                assert p == pytest.approx(goal, abs=1.0 if volume < 1e-6 else 3e3)


@SETTINGS
@given(
    start=st.floats(-90e3, 500e3),
    setpoint=st.floats(-200e3, 600e3),
    dt=st.floats(1e-6, 0.1),
    log_volume=st.floats(-11, -4),
    stretch=st.floats(0.2, 4.0),
    exponent=st.floats(1.0, 1.4),
    leak=st.floats(0.0, 1e-9),
    band=st.floats(1.0, 5e4),
)
def test_mass_flow_and_stiffness_agree_at_any_step(
    start, setpoint, dt, log_volume, stretch, exponent, leak, band
):
    """The gas law holds, the flow has the sign of the gap, and dp/dV is that of the step itself."""
    model = ValveModel(polytropic=exponent, leak_m3_s_pa=leak, band_pa=band)
    volume = 10.0**log_volume
    end = volume * stretch

    def stepped(v):
        chambers = Chambers(model, volume, start)
        before = chambers.mass[0]
        p, slope = chambers.step(setpoint, dt, v)
        return p + AMBIENT_PA, slope, chambers.mass[0] - before, chambers.mass[0]

    p, slope, gained, mass = stepped(end)
    gas = make_gas(model, np.array([volume]))
    assert p > 0.0
    assert mass > 0.0
    assert p == pytest.approx(AMBIENT_PA * (mass / gas.density / end) ** exponent, rel=1e-9)
    # Between the pressures of a closed chamber and of the ports, before and after it was stretched.
    few, many = min(start + AMBIENT_PA, AMBIENT_PA), max(start + AMBIENT_PA, gas.supply)
    thin, dense = min(1.0, stretch**-exponent), max(1.0, stretch**-exponent)
    assert few * thin * (1 - 1e-9) <= p <= many * dense * (1 + 1e-9)
    assert -exponent * p / end * (1 + 1e-9) <= slope <= 0.0
    if leak == 0.0 and stretch == 1.0:
        goal = min(max(setpoint, 0.0), 150e3)
        assert gained * (goal - start) >= 0.0
    h = 1e-6 * end
    (low, low_slope, *_), (high, high_slope, *_) = stepped(end - h), stepped(end + h)
    steepest = min(low_slope, slope, high_slope)
    flattest = max(low_slope, slope, high_slope)
    noise = 1e-8 * p / end
    assert 1.001 * steepest - noise <= (high - low) / (2 * h) <= 0.999 * flattest + noise


def test_a_chamber_closed_to_nothing_is_refused():
    gas = make_gas(ValveModel(), np.array([V]))
    out = [np.empty(1) for _ in range(3)]
    for volumes in ((V, 0.0), (V, -V), (0.0, V), (math.nan, V)):
        start, end = (np.array([v]) for v in volumes)
        assert not chamber_pressures(gas, np.array([1e-5]), start, end, np.zeros(1), 1e-3, *out)


# Valves that are not healthy -----------------------------------------------------------------------
class Faulty(Chambers):
    """Chambers behind valves in a condition."""

    def __init__(self, model, volume, pressure=0.0, **changes):
        super().__init__(model, volume, pressure)
        values = {name: np.full(len(self.volume), float(value)) for name, value in changes.items()}
        self.gas = make_gas(model, self.volume, replace(healthy(len(self.volume)), **values))

    def after(self, seconds, setpoint, dt=1e-3):
        for _ in range(round(seconds / dt)):
            p, _ = self.step(setpoint, dt)
        return p


def test_a_healthy_condition_changes_nothing():
    assert all(
        np.array_equal(a, b)
        for a, b in zip(make_gas(OPEN, [V]), make_gas(OPEN, [V], healthy(1)), strict=True)
    )


def test_a_loss_beside_the_valve_takes_its_part_each_second():
    """Isothermal it is p' = -k p, as hardware models have it; backward in time, of first order."""
    errors = [
        abs(Faulty(CLOSED, V, 40e3, loss_1_s=3.0).after(0.4, 40e3, dt) / 40e3 - math.exp(-1.2))
        for dt in (1e-3, 5e-4)
    ]
    assert errors[0] < 1e-3
    assert errors[1] < 0.6 * errors[0]
    assert Faulty(CLOSED, V, -40e3, loss_1_s=500.0).after(0.1, 0.0, 0.02) == pytest.approx(0.0, abs=1.0)


def test_a_valve_that_has_let_go_is_open_to_the_air_both_ways():
    """As fast as a valve whose band is nothing, whatever its target; from a vacuum too."""
    expected = Chambers(OPEN, V, 60e3)
    gone = Faulty(ValveModel(exhaust_pa=-90e3, band_pa=20e3), V, 60e3, is_open=1.0)
    for _ in range(100):
        p, _ = gone.step(90e3, 1e-3)
        assert p == pytest.approx(expected.step(0.0, 1e-3)[0], rel=1e-12, abs=1e-6)
    assert Faulty(ValveModel(exhaust_pa=-90e3), V, -60e3, is_open=1.0).after(1.0, -60e3) == pytest.approx(
        0.0, abs=1.0
    )


def test_orifices_and_supply_in_part():
    full, half = (
        Faulty(OPEN, V, 0.0, fill=part).after(0.01 / part, 90e3, 1e-4 / part) for part in (1.0, 0.5)
    )
    assert half == pytest.approx(full, rel=1e-12)
    full, half = (
        Faulty(OPEN, V, 80e3, vent=part).after(0.01 / part, 0.0, 1e-4 / part) for part in (1.0, 0.5)
    )
    assert half == pytest.approx(full, rel=1e-12)
    assert Faulty(OPEN, V, 80e3, vent=0.0).after(1.0, 0.0) == pytest.approx(80e3)
    assert Faulty(OPEN, V, 80e3, vent=0.0, is_open=1.0).after(1.0, 0.0) == pytest.approx(80e3)
    assert Faulty(OPEN, V, 10e3, fill=0.0, vent=0.0).after(1.0, 90e3) == pytest.approx(10e3)
    assert Faulty(OPEN, V, 0.0, supply_pa=20e3).after(2.0, 90e3) == pytest.approx(20e3)
