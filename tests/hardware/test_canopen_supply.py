"""Supply pressure over CANopen: from the device's TPDO 2 to the monitor that trips by name."""

import numpy as np
import pytest
from hardware_bench import Bench, codes, platform, single

from soro_core.emulation.vocabulary import Injection
from tests.apparatus.faults.cells import run
from tests.apparatus.faults.rows import CHAMBER, Row


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
