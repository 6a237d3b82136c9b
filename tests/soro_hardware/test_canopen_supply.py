"""Supply pressure and temperature over CANopen: from the device's TPDO 2 to a trip with its name."""

import numpy as np
import pytest
from hardware_bench import Bench, codes, platform, single

from soro_hardware.canopen.frames import emergency_text
from soro_hardware.emulation.faults.fault_types import Injection
from tests.apparatus.faults.cells import run
from tests.apparatus.faults.rows import CHAMBER, Row
from tests.refused import refused


def drop(bench, supply_pa, chamber="link0/chamber1"):
    bench.world.faults.add(Injection(fault="supply_drop", chamber=chamber, value=supply_pa))


@pytest.fixture
def bench():
    bench = Bench(platform())
    bench.driver.configure()
    return bench


def test_every_chamber_gets_that_of_its_node(bench):
    assert np.isnan(bench.exchange(20e3).supply_pa[1:]).any(), "not yet reported by all"
    np.testing.assert_array_equal(bench.run(5, 20e3).supply_pa, [150e3] * 3)
    drop(bench, 61.23e3)
    np.testing.assert_array_equal(bench.run(30, 20e3).supply_pa, [150e3, 61.2e3, 150e3])
    assert bench.exchange(20e3).faults == (), "what to make of it is not the driver's to say"


def test_the_chambers_of_a_node_have_one_supply():
    valves = [
        {"chamber": f"link{n}/chamber{c}", "node": n + 1, "channel": c} for n in range(2) for c in (3, 0)
    ]
    bench = Bench(platform(valves=valves, canopen={"mapping": {"device": "cia408_4ch"}}))
    bench.driver.configure()
    drop(bench, 60e3, "link1/chamber0")
    np.testing.assert_array_equal(bench.run(30, 20e3).supply_pa, [150e3, 150e3, 60e3, 60e3])


def test_comes_every_100_ms_also_when_it_flickers(bench):
    bench.run(20, 20e3)
    bench.bus.take_log()
    for n in range(200):
        bench.world.nodes[0].dictionary.values[0x2100, 2] = 250 + n
        bench.exchange(20e3)
    assert sum(line.startswith("< 281") for line in bench.bus.take_log()) == 10


def test_a_supply_that_is_not_reported_any_more_is_a_fault(bench):
    bench.run(20, 20e3)
    bench.bus.swallow = {0x282}
    assert bench.run(75, 20e3).faults == ()
    result = bench.run(45, 20e3)
    assert codes(result) == {("stale_reading", "link0/chamber1 (node 2)")}
    assert "no supply pressure for " in result.faults[0].message
    bench.bus.swallow = set()
    assert bench.run(20, 20e3).faults == ()


def test_start_up_forgets_what_was_reported(bench):
    bench.run(20, 20e3)
    drop(bench, 20e3, "link0/chamber0")
    bench.driver.configure()
    assert not (bench.exchange(20e3).supply_pa == 150e3)[0]


def test_a_device_that_does_not_report_it():
    mapping = {"supply": None, "tpdos": [{"number": 1, "entries": ["status", "reading"]}]}
    bench = Bench(single(canopen={"mapping": mapping}))
    bench.driver.configure()
    assert bench.run(20, 20e3).supply_pa is None


def test_scale_and_zero_are_those_of_the_mapping():
    supply = {"index": 0x2100, "sub": 1, "pa_per_count": 1000.0, "zero_count": 101}
    bench = Bench(single(canopen={"mapping": {"supply": supply}}, emulation={"supply_pa": 600e3}))
    bench.driver.configure()
    bench.bus.take_log()
    assert bench.run(20, 20e3).supply_pa == [600e3]
    assert "< 281 [5] 00 BD 02 FA 00" in bench.bus.take_log()  # 701 counts


@pytest.mark.parametrize(("maximum_pa", "supply_pa"), [(90e3, 150e3), (500e3, 560e3)])
def test_healthy_emulated_supply_suffices_for_the_range(maximum_pa, supply_pa):
    bench = Bench(single(range={"maximum_pa": maximum_pa}, rating={"maximum_pa": 600e3}))
    assert bench.world.nodes[0].valve.supply_pa(supply_pa) == supply_pa
    bench.driver.configure()
    assert bench.run(20, 20e3).supply_pa == [supply_pa]


def test_low_supply_trips_by_its_name():
    """Before the model misses the pressure: reported within 100 ms, and low for 100 ms."""
    low = Row("supply_drop, supply_pa: 20e3", "trip", f"supply low: {CHAMBER} has 20.0 kPa, needs ", 250.0)
    assert run("canopen_408", low).problems == ()
    just_enough = Row("supply_drop, supply_pa: 142e3", "tolerate")
    assert run("canopen_408", just_enough).problems == ()


def test_high_supply_trips_by_its_name():
    """The default bears compressed air of 10 bar, and a limit says what the parts bear."""
    high = Row("supply_rise, supply_pa: 1.2e6", "trip", f"supply high: {CHAMBER} has 1200.0 kPa, ", 250.0)
    assert run("canopen_408", high).problems == ()
    assert run("canopen_408", Row("supply_rise, supply_pa: 1.0e6", "tolerate")).problems == ()


def test_a_temperature_above_its_limit_is_a_fault_of_its_node(bench):
    bench.run(20, 20e3)
    heat = {"fault": "overheat", "chamber": "link0/chamber1"}
    bench.world.faults.add(Injection(value=69.9, **heat))
    assert bench.run(30, 20e3).faults == ()
    bench.world.faults.add(Injection(value=70.1, **heat))
    result = bench.run(30, 20e3)
    assert codes(result) == {("over_temperature", "link0/chamber1 (node 2)")}
    assert "70.1 degC, allowed 70 degC" in result.faults[0].message
    bench.world.faults.clear()
    bench.driver.configure()
    assert bench.run(30, 20e3).faults == ()


def test_limit_scale_and_zero_of_a_temperature_are_those_of_the_platform():
    heat = {"index": 0x2100, "sub": 2, "celsius_per_count": 0.5, "zero_count": -100}
    bench = Bench(single(canopen={"mapping": {"temperature": heat}, "most_celsius": 40.0}))
    bench.driver.configure()
    fault = {"fault": "overheat", "chamber": "link0/chamber0"}
    bench.world.faults.add(Injection(value=39.5, **fault))
    assert bench.run(30, 20e3).faults == ()
    assert bench.world.nodes[0].dictionary.get(0x2100, 2) == 39.5 / 0.5 - 100
    bench.world.faults.add(Injection(value=41.0, **fault))
    assert {code for code, _ in codes(bench.run(30, 20e3))} == {"over_temperature"}


def test_a_temperature_that_no_tpdo_has_is_not_watched():
    """As in a platform file with TPDOs of its own."""
    tpdos = [
        {"number": 1, "entries": ["status", "reading"]},
        {"number": 2, "entries": [{"index": 0x1001}, "supply"], "transmission": "event"},
    ]
    bench = Bench(single(canopen={"mapping": {"tpdos": tpdos}}))
    bench.driver.configure()
    bench.world.faults.add(Injection(fault="overheat", chamber="link0/chamber0", value=200.0))
    assert bench.run(30, 20e3).faults == ()


def test_a_tpdo_with_a_temperature_of_no_object_is_refused():
    with refused("canopen.mapping", names=("rpdos, tpdos",)):
        single(canopen={"mapping": {"temperature": None}})


@pytest.mark.parametrize(
    ("code", "words"),
    [(0x4200, "0x4200 device temperature"), (0x4210, "0x4210 device temperature"),
     (0x4110, "0x4110 ambient temperature"), (0x3120, "0x3120 supply low"), (0x9042, "0x9042")],
)  # fmt: skip
def test_emergencies_in_words(code, words):
    assert emergency_text(code) == words
