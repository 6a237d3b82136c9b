"""The vocabulary of faults on serial lines: what is tolerated, what latches, and that the others vent."""

import re

import numpy as np
import pytest
from serial_bench import SerialBench, alicat, itv, quiet

from soro_hardware.emulation.faults.fault_types import Injection

MAKE = {
    "itv": lambda: SerialBench(itv(**quiet())),
    "alicat": lambda: SerialBench(alicat(**quiet())),
    "alicat old": lambda: SerialBench(alicat(**quiet(firmware="5v12.0-R22"))),
}
FIRST = "link0/chamber0"
TOLERATED = {
    "drop": ({"p": 0.01}, "frames_lost"),
    "corrupt_bits": ({"p": 0.01}, "frames_garbled"),
    "truncate": ({"p": 0.01}, "frames_lost"),
    "duplicate": ({"p": 0.01}, "frames_late"),
    "garbage_line": ({"p": 0.01}, "frames_garbled"),
    "delay": ({"delay_s": 0.01}, ""),
}
LATCHED = {
    "reboot": {"rebooted"},
    "brownout": {"device_silent", "rebooted"},
    "mute": {"device_silent"},
    "setpoint_ignored": {"rebooted", "setpoint_ignored"},
}


@pytest.fixture(params=MAKE)
def bench(request):
    bench = MAKE[request.param]()
    bench.driver.configure()
    assert bench.run(120, 20e3, 40e3, 60e3).faults == ()
    return bench


def inject(bench, fault, chamber="", **parameters):
    bench.devices.faults.add(Injection.model_validate({"fault": fault, "chamber": chamber, **parameters}))


@pytest.mark.parametrize("fault", TOLERATED)
def test_a_disturbed_line_is_counted_and_tolerated(bench, fault):
    parameters, count = TOLERATED[fault]
    before = bench.driver.statistics
    inject(bench, fault, **parameters)
    for cycle in range(600):
        result = bench.exchange(20e3, 40e3 + 10e3 * np.sin(cycle / 30), 60e3)
        assert result.faults == ()
    statistics = bench.driver.statistics
    kinds = ("frames_lost", "frames_garbled", "frames_late", "frames_refused")
    noticed = sum(getattr(statistics, kind) - getattr(before, kind) for kind in kinds)
    assert noticed > 0 or not count
    bench.devices.faults.clear()
    bench.run(60, 20e3, 40e3, 60e3)
    np.testing.assert_allclose(bench.devices.pressure_pa, [20e3, 40e3, 60e3], atol=200)


@pytest.mark.parametrize("fault", LATCHED)
def test_a_faulty_device_latches_and_the_others_vent(bench, fault):
    inject(bench, fault, FIRST, duration_s=0.6)
    seen = set()
    for cycle in range(160):
        result = bench.exchange(20e3 + 5e3 * np.sin(cycle / 20), 40e3, 60e3)
        seen |= {fault.code for fault in result.faults if fault.latched}
    assert seen & LATCHED[fault]
    assert seen <= LATCHED[fault] | {"stale_reading"}
    assert {fault.source.split(" ")[0] for fault in result.faults} == {FIRST}
    assert bench.devices.pressure_pa[1:].max() < 1.5e3
    bench.devices.faults.clear()
    bench.run(20, 20e3, 40e3, 60e3)
    assert bench.devices.pressure_pa[1:].max() < 1.5e3, "only configure clears it"
    bench.driver.configure()
    assert bench.run(120, 20e3, 40e3, 60e3).faults == ()


def test_a_dead_line_is_a_silent_device_on_it(bench):
    inject(bench, "drop", p=1.0)
    result = bench.run(200, 20e3, 40e3, 60e3)
    assert {fault.code for fault in result.faults} == {"device_silent"}
    assert not result.sent_pa.any()


# -- start-up under load ---------------------------------------------------------------------------


def disturbed(bench, number, late):
    """Let an answer of the devices get lost, or come with the next one on its line; how many there were."""
    count = 0

    def way():
        held = b""

        def to_host(message):
            nonlocal count, held
            count += 1
            if count - 1 == number:
                held = message if late else b""
                return b""
            message, held = held + message, b""
            return message

        return to_host

    for line in bench.devices.lines:
        line.to_host = way()
    return lambda: count


@pytest.mark.parametrize("late", [False, True], ids=["lost", "late"])
@pytest.mark.parametrize("make", [itv, alicat], ids=["itv", "alicat"])
def test_an_answer_that_is_lost_or_late_does_not_end_the_start_up(make, late):
    """As of a device, or an emulator's process, that was held up for longer than an answer may take."""
    number = 0
    while True:
        bench = SerialBench(make(2))
        count = disturbed(bench, number, late)
        bench.driver.configure()
        assert bench.run(20, 0.0).faults == ()
        number += 1
        if number >= count():
            break
    assert number >= 8


@pytest.mark.parametrize("make", [itv, alicat], ids=["itv", "alicat"])
def test_a_set_point_that_the_line_has_changed_is_sent_again_at_once(make):
    """One bit of a digit: the device takes 60 kPa for 20 and reports it; it has not been restarted."""
    bench = SerialBench(make(1, **quiet()))
    bench.driver.configure()
    bench.run(80, 18e3)
    line, changed = bench.devices.lines[0], []

    def change(chunk):
        spoilt = re.sub(rb"(SET |LS )[12](?=\d)", lambda found: found[1] + b"6", chunk)
        if changed or spoilt == chunk:
            return chunk
        changed.append(spoilt)
        return spoilt

    line.to_devices = change
    highest = 0.0
    for _ in range(80):
        assert bench.exchange(20e3).faults == ()
        highest = max(highest, float(bench.devices.pressure_pa[0]))
    assert changed
    # The valve goes the wrong way for two rounds of set point and reading at most, each asked in a cycle.
    model = bench.platform.regulator
    wrong_s = 2 * max(1 / bench.driver.update_hz, 2e-9 * bench.period_ns)
    assert highest < 60e3 - (60e3 - 18e3) * np.exp(-wrong_s / model.tau_s)
    assert bench.devices.pressure_pa[0] == pytest.approx(20e3, abs=500.0)
