"""What every family of regulators must do, through the port alone; a new one is added to `FAMILIES`."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from board_bench import BoardBench, VeabBench, board_platform, veab_platform
from hardware_bench import PERIOD_NS, Bench, platform
from serial_bench import AIR, COMMON, SerialBench, alicat, itv

from examples.line_family import LinePlatform, LineRegulator, emulate
from soro_core.config import parse
from soro_core.errors import HardwareError
from soro_core.hardware.emulation.line_link import LineLink
from soro_core.hardware.port import FAULT_CODES, Regulator


@dataclass
class Rig:
    """A regulator on emulated devices, and the true pressures behind it."""

    regulator: Regulator
    true_pa: Callable[[], np.ndarray]
    restart_device: Callable[[], None]
    resolution_pa: float
    cycles_an_update: int = 1  # exchanges in which every chamber is sampled once
    restart_fault: str = "rebooted"
    now_ns: int = 0

    def run(self, cycles, *setpoints):
        for _ in range(cycles):
            self.now_ns += PERIOD_NS
            result = self.regulator.exchange(np.full(self.regulator.n_chambers, setpoints), self.now_ns)
        return result

    def sampled(self, *setpoints):
        """Which chambers are sampled in the exchanges of one update."""
        return np.any([self.run(1, *setpoints).fresh for _ in range(self.cycles_an_update)], axis=0)


def canopen() -> Rig:
    bench = Bench(platform())
    return Rig(
        bench.driver,
        lambda: bench.world.pressure_pa,
        lambda: bench.world.nodes[0].reset(bench.world.now_ns),
        resolution_pa=10.0,
    )


def veab() -> Rig:
    bench = VeabBench(veab_platform())
    # The server says nothing of itself: all that shows is that the connection broke.
    return Rig(bench.driver, lambda: bench.devices.pressure_pa, bench.restart, 0.1, restart_fault="link_lost")


def board() -> Rig:
    bench = BoardBench(board_platform())
    return Rig(bench.driver, lambda: bench.devices.pressure_pa, bench.devices.power_cycle, 1.0)


def serial(platform, resolution_pa, cycles_an_update) -> Rig:
    bench = SerialBench(platform)
    return Rig(
        bench.driver,
        lambda: bench.devices.pressure_pa,
        lambda: bench.valves[0].reboot(bench.devices.now_ns),
        resolution_pa,
        cycles_an_update,
    )


def line() -> Rig:
    """The family that docs/adding_a_family.md explains."""
    platform = parse(LINE, LinePlatform, "test")
    devices = emulate(platform, lockstep=True, seed=0)
    driver = LineRegulator(platform, LineLink(devices.line), time.monotonic, lockstep=True)
    return Rig(driver, lambda: devices.pressure_pa, devices.reboot, 1.0)


LINE = {
    "family": "line",
    "transport": {"kind": "tcp", "port": 4000},
    "valves": [{"chamber": f"link0/chamber{n}"} for n in range(3)],
    "range": {"minimum_pa": 0.0, "maximum_pa": 90e3},
    "cycle_hz": 200.0,
    "emulation": {"regulator": AIR},
}
FAMILIES = {
    "canopen_408": canopen,
    "veab_tcp": veab,
    "soro_board": board,
    "itv_rs232": lambda: serial(itv(), 1e5 / 1023, 10),
    "line": line,
    "alicat": lambda: serial(alicat(), 10.0, 8),
    "alicat at 19200 with firmware 5": lambda: serial(
        alicat(baud=19200, emulation={**COMMON["emulation"], "firmware": "5v12.0-R22"}), 10.0, 20
    ),
}


@pytest.fixture(params=FAMILIES.values(), ids=FAMILIES.keys())
def rig(request):
    rig = request.param()
    yield rig
    rig.regulator.close()


@pytest.fixture
def ready(rig):
    rig.regulator.configure()
    return rig


def test_names(rig):
    assert rig.regulator.n_chambers == len(rig.regulator.chamber_names) == 3


def test_no_exchange_before_configure(rig):
    with pytest.raises(HardwareError):
        rig.run(1, 10e3)


def test_no_pressure_by_configure(ready):
    assert ready.true_pa().max() < 500.0


def test_exchange_reports_what_was_sent_and_read(ready):
    result = ready.run(100, 12_345.0, 45_678.0, 78_901.0)
    assert result.faults == ()
    assert result.fresh.dtype == bool
    np.testing.assert_allclose(
        result.sent_pa, [12_345.0, 45_678.0, 78_901.0], atol=ready.resolution_pa / 2 + 1e-9
    )
    np.testing.assert_allclose(result.pressure_pa, ready.true_pa(), atol=1000.0)
    np.testing.assert_allclose(ready.true_pa(), result.sent_pa, atol=600.0)
    assert ready.sampled(12_345.0, 45_678.0, 78_901.0).all()


def test_says_what_it_can(ready):
    assert isinstance(ready.regulator.device_watchdog, bool)
    assert 1.0 < ready.regulator.update_hz <= 1e9 / PERIOD_NS


def test_results_are_the_callers_own(ready):
    first = ready.run(1, 10e3)
    kept = first.sent_pa.copy(), first.pressure_pa.copy()
    ready.run(50, 80e3)
    np.testing.assert_array_equal(first.sent_pa, kept[0])
    np.testing.assert_array_equal(first.pressure_pa, kept[1])


def test_edges_of_the_range(ready):
    assert ready.run(1, 0.0).faults == ()
    assert ready.run(1, 90e3).faults == ()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 90e3 + 1, -1.0])
def test_bad_set_point_is_refused_and_nothing_is_pressurised(ready, bad):
    result = ready.run(50, 80e3, bad, 80e3)
    assert {fault.code for fault in result.faults} == {"refused_setpoint"}
    assert not result.sent_pa.any()
    assert ready.true_pa().max() < 500.0


def test_wrong_shape(ready):
    with pytest.raises(HardwareError):
        ready.regulator.exchange(np.zeros(4), 0)


def test_vent_is_at_once_and_idempotent(ready):
    ready.run(100, 80e3)
    for _ in range(60):
        ready.regulator.vent()
    assert ready.true_pa().max() < 5e3
    assert ready.run(100, 30e3).faults == ()
    np.testing.assert_allclose(ready.true_pa(), 30e3, atol=600.0)


def test_vent_never_raises(rig):
    rig.regulator.vent()
    rig.regulator.configure()
    rig.regulator.vent()
    rig.regulator.close()
    rig.regulator.vent()


def test_restarted_device_latches_until_configured(ready):
    ready.run(100, 60e3)
    ready.restart_device()
    result = ready.run(100, 60e3)
    assert ready.restart_fault in {fault.code for fault in result.faults if fault.latched}
    assert {fault.code for fault in result.faults} <= set(FAULT_CODES)
    assert all(fault.source and fault.message for fault in result.faults)
    assert ready.true_pa().max() < 500.0
    ready.regulator.configure()
    assert ready.run(100, 60e3).faults == ()


def test_close_vents_and_is_idempotent(ready):
    ready.run(100, 80e3)
    ready.regulator.close()
    assert ready.true_pa().max() < 2.5e3
    ready.regulator.close()
    with pytest.raises(HardwareError):
        ready.run(1, 10e3)


def test_statistics_are_counts_that_only_grow(ready):
    before = ready.regulator.statistics
    ready.run(10, 10e3)
    after = ready.regulator.statistics
    assert after.cycles == before.cycles + 10
    assert after.frames_sent > before.frames_sent
    ready.regulator.configure()
    ready.regulator.close()
    last = vars(ready.regulator.statistics)
    assert all(last[name] >= value for name, value in vars(after).items())
