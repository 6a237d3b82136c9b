"""On every family the newest command goes out with the exchange that follows it; an old one never does."""

import numpy as np
import pytest

from soro_core.safety import Limits
from tests.apparatus.faults.rigs import PLATFORMS, Loop, rig_of
from tests.apparatus.faults.rows import Row

LIMITS = Limits()


class Noted(Loop):
    """A loop that notes what the driver is given in every exchange."""

    def __init__(self, family):
        rig = rig_of(family, Row("", "tolerate"))
        rig.regulator.configure()
        super().__init__(rig)
        self.given, exchange = [], rig.regulator.exchange

        def noted(setpoint_pa, now_ns):
            self.given.append(setpoint_pa.copy())
            return exchange(setpoint_pa, now_ns)

        rig.regulator.exchange = noted

    def command(self, level_pa, cycles=1):
        for _ in range(cycles):
            self.cycle(None if level_pa is None else np.full(self.rig.regulator.n_chambers, level_pa))


@pytest.fixture(params=PLATFORMS)
def loop(request):
    found = Noted(request.param)
    yield found
    found.rig.close()


def test_a_command_is_sent_with_the_exchange_that_follows_it(loop):
    loop.command(0.0, 3)
    step_pa = LIMITS.rise_pa_s * loop.rig.period_s
    loop.command(40e3)
    assert loop.given[-1] == pytest.approx(step_pa)
    loop.command(0.0)
    assert not loop.given[-1].any(), "down as soon as it is asked for"
    if not loop.limited.in_turn:
        loop.command(40e3)
        assert loop.exchange.sent_pa == pytest.approx(step_pa, abs=100.0), "on the wire too"


def test_a_command_that_is_too_old_is_never_sent(loop):
    loop.command(20e3, round(0.3 / loop.rig.period_s))
    assert loop.given[-1].min() == 20e3
    fed = loop.cycles
    while not loop.vented:
        assert loop.given[-1].min() == 20e3
        loop.command(None)
        assert loop.cycles < fed + 100
    assert loop.cause.startswith("command lost")
    age_s = (loop.cycles - fed) * loop.rig.period_s
    assert age_s == pytest.approx(LIMITS.command_age_s, abs=1.01 * loop.rig.period_s)
    assert not loop.given[-1].any(), "zeros in the very exchange in which it is too old"


def test_readings_are_compared_with_what_the_set_points_before_them_have_led_to(loop):
    """While set points run up and down at the fastest: a prediction that is a cycle off is 1 kPa off."""
    off = []
    for cycle in range(round(1.5 / loop.rig.period_s)):
        loop.command(60e3 if cycle * loop.rig.period_s % 0.6 < 0.3 else 10e3)
        found = loop.exchange
        off.append(
            np.where(
                found.fresh, loop.limited.state.monitors.expected.pressure_pa - found.pressure_pa, np.nan
            )
        )
    assert loop.cause is None
    rms_pa = float(np.sqrt(np.nanmean(np.square(off))))
    # Noise of 100 Pa; in turn, set point and reading each wait for their turn.
    assert rms_pa < (800.0 if loop.limited.in_turn else 150.0)
