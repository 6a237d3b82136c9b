"""Benches of emulated devices in the states that the tests start from, and which tests are in real time."""

import pytest
from hardware_bench import Bench, platform, single

# Helpers by which a test module starts processes, or waits for devices, in real time.
REAL_TIME = {
    "cycles_in_real_time",
    "driver_process",
    "emulator",
    "frames_until",
    "served",
    "serving",
    "wait_for",
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of modules that use a helper of real time."""
    for item in items:
        if isinstance(item, pytest.Function) and REAL_TIME & vars(item.module).keys():
            item.add_marker(pytest.mark.real_time)


@pytest.fixture
def powered() -> Bench:
    """One node as it comes from power-on: pre-operational, nothing configured."""
    return Bench(single())


@pytest.fixture
def running() -> Bench:
    """One node in ACTIVE at 50 kPa."""
    bench = Bench(single())
    bench.driver.configure()
    bench.run(100, 50e3)
    bench.bus.take_log()
    return bench


@pytest.fixture
def arm() -> Bench:
    """Three valves at 20, 40 and 60 kPa."""
    bench = Bench(platform())
    bench.driver.configure()
    result = bench.run(100, 20e3, 40e3, 60e3)
    assert result.faults == ()
    bench.bus.take_log()
    return bench
