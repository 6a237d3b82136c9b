"""What every family of regulators must do, through the port alone; a new one is added to `FAMILIES`.

On real devices: pytest -m hil tests/soro_hardware/test_conformance.py --platform FILE [--device ADDRESS].
There every set point is a part of --most-pa, and only the devices know the pressures (docs/hil.md).
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from board_bench import BoardBench, VeabBench, board_platform, veab_platform
from hardware_bench import PERIOD_NS, Bench, platform
from serial_bench import AIR, COMMON, SerialBench, alicat, itv
from vtem_bench import VtemBench, vtem_platform

from docs.line_family import LineDevice, LinePlatform, LineRegulator
from soro_core.config import parse
from soro_core.errors import HardwareError
from soro_hardware.families import load_platform, open_regulator
from soro_hardware.port import FAULT_CODES, Regulator
from tests.soro_hardware.line_link import LineLink


@dataclass
class Rig:
    """A regulator on emulated devices, and the true pressures behind it."""

    regulator: Regulator
    true_pa: Callable[[], np.ndarray]
    restart_device: Callable[[], None]
    resolution_pa: float
    cycles_an_update: int = 1  # exchanges in which every chamber is sampled once
    restart_fault: str = "rebooted"
    n_chambers: int = 3
    cycle_hz: float = 1e9 / PERIOD_NS
    range_pa: tuple[float, float] = (0.0, 90e3)
    scale: float = 1.0  # of every set point
    empty_pa: float = 500.0
    level_pa: float = 600.0  # play of the valves, and noise
    now_ns: int = 0

    def run(self, cycles, *setpoints):
        for _ in range(cycles):
            self._wait()
            result = self.regulator.exchange(self.setpoints(*setpoints), self.now_ns)
        return result

    def setpoints(self, *values):
        """As many as there are chambers."""
        return np.resize(values, self.n_chambers) * self.scale

    def bad(self, what):
        """A set point that must be refused, before it is scaled."""
        low, high = self.range_pa
        known = {"above": (high + 1) / self.scale, "below": (low - 1) / self.scale}
        return known[what] if what in known else float(what)

    def vent(self, cycles):
        for _ in range(cycles):
            self.regulator.vent()

    def _wait(self):
        self.now_ns += PERIOD_NS

    def sampled(self, *setpoints):
        """Which chambers are sampled in the exchanges of one update."""
        return np.any([self.run(1, *setpoints).fresh for _ in range(self.cycles_an_update)], axis=0)


@dataclass
class Real(Rig):
    """Real devices in real time: what they read is all that is known of their pressures."""

    read_pa: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def run(self, cycles, *setpoints):
        for _ in range(cycles):
            result = super().run(1, *setpoints)
            self.read_pa = result.pressure_pa
        return result

    def vent(self, cycles):
        """The exchanges go on, for devices vent and latch when their host falls silent."""
        for _ in range(max(cycles, round(0.5 * self.cycle_hz))):
            self.regulator.vent()
            self.run(1, 0.0)

    def _wait(self):
        due_s = self.now_ns * 1e-9 + 1.0 / self.cycle_hz
        time.sleep(min(max(due_s - time.monotonic(), 0.0), 1.0 / self.cycle_hz))
        self.now_ns = time.monotonic_ns()


def real(options: pytest.Config) -> Rig:
    name, device = options.getoption("--platform"), options.getoption("--device")
    if not name:
        pytest.skip("no real devices: pytest -m hil --platform FILE [--device ADDRESS]")
    described = load_platform(name)
    if described.family == "veab_tcp":
        pytest.skip("the published VEAB server ends with its client and is not started again for every test")
    regulator = open_regulator(described, device)
    rig = Real(
        regulator,
        lambda: rig.read_pa,
        lambda: pytest.skip("a real device is not restarted"),
        resolution_pa=200.0,
        cycles_an_update=math.ceil(described.cycle_hz / regulator.update_hz) + 1,
        n_chambers=len(described.valves),
        cycle_hz=described.cycle_hz,
        range_pa=(described.range.minimum_pa, described.range.maximum_pa),
        scale=options.getoption("--most-pa") / 90e3,
        empty_pa=1e3,
        level_pa=1.5e3,
    )
    return rig


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


def vtem(**registers) -> Rig:
    bench = VtemBench(vtem_platform(registers=registers))
    return Rig(bench.driver, lambda: bench.devices.pressure_pa, bench.devices.reboot, 100.0)


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
    devices = LineDevice(platform, lockstep=True, seed=0)
    driver = LineRegulator(platform, LineLink(devices.line), time.monotonic, lockstep=True)
    return Rig(driver, lambda: devices.pressure_pa, devices.reboot, 1.0)


LINE = {
    "family": "line",
    "transport": {"kind": "tcp", "port": 4000},
    "valves": [{"chamber": f"link0/chamber{n}"} for n in range(3)],
    "range": {"minimum_pa": 0.0, "maximum_pa": 90e3},
    "cycle_hz": 200.0,
    "regulator": AIR,
}
FAMILIES = {
    "canopen_408": canopen,
    "veab_tcp": veab,
    "soro_board": board,
    "itv_rs232": lambda: serial(itv(), 1e5 / 1023, 10),
    "vtem_modbus": vtem,
    "vtem_modbus by one message a cycle": lambda: vtem(one_transaction=True),
    "line": line,
    "alicat": lambda: serial(alicat(), 10.0, 8),
    "alicat at 19200 with firmware 5": lambda: serial(
        alicat(baud=19200, emulation={**COMMON["emulation"], "firmware": "5v12.0-R22"}), 10.0, 20
    ),
}


REAL = pytest.param(None, id="real", marks=pytest.mark.hil)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Every test on every family; on real devices where they are asked for."""
    if "rig" in metafunc.fixturenames:
        options = metafunc.config.option
        real_too = options.platform or "hil" in options.markexpr
        emulated = [pytest.param(make, id=name) for name, make in FAMILIES.items()]
        metafunc.parametrize("rig", [*emulated, *([REAL] if real_too else [])], indirect=True)


@pytest.fixture
def rig(request):
    rig = real(request.config) if request.param is None else request.param()
    yield rig
    rig.regulator.close()


@pytest.fixture
def ready(rig):
    rig.regulator.configure()
    return rig


def test_names(rig):
    assert rig.regulator.n_chambers == len(rig.regulator.chamber_names) == rig.n_chambers


def test_no_exchange_before_configure(rig):
    with pytest.raises(HardwareError):
        rig.run(1, 10e3)


def test_no_pressure_by_configure(ready):
    ready.run(2 * ready.cycles_an_update, 0.0)
    assert ready.true_pa().max() < ready.empty_pa


def test_exchange_reports_what_was_sent_and_read(ready):
    values = 12_345.0, 45_678.0, 78_901.0
    result = ready.run(100, *values)
    assert result.faults == ()
    assert result.fresh.dtype == bool
    wanted = ready.setpoints(*values)
    np.testing.assert_allclose(result.sent_pa, wanted, atol=ready.resolution_pa / 2 + 1e-9)
    np.testing.assert_allclose(result.pressure_pa, ready.true_pa(), atol=1000.0)
    np.testing.assert_allclose(ready.true_pa(), result.sent_pa, atol=ready.level_pa)
    assert ready.sampled(*values).all()


def test_says_what_it_can(ready):
    assert isinstance(ready.regulator.device_watchdog, bool)
    assert 1.0 < ready.regulator.update_hz <= ready.cycle_hz


def test_results_are_the_callers_own(ready):
    first = ready.run(1, 10e3)
    kept = first.sent_pa.copy(), first.pressure_pa.copy()
    ready.run(50, 80e3)
    np.testing.assert_array_equal(first.sent_pa, kept[0])
    np.testing.assert_array_equal(first.pressure_pa, kept[1])


def test_edges_of_the_range(ready):
    assert ready.run(1, 0.0).faults == ()
    if ready.scale < 1.0:
        pytest.skip("the highest set point is not for a suite of tests")
    assert ready.run(1, 90e3).faults == ()


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf", "above", "below"])
def test_bad_set_point_is_refused_and_nothing_is_pressurised(ready, bad):
    result = ready.run(50, ready.bad(bad), 80e3, 80e3)
    assert {fault.code for fault in result.faults} == {"refused_setpoint"}
    assert not result.sent_pa.any()
    assert ready.true_pa().max() < ready.empty_pa


def test_wrong_shape(ready):
    with pytest.raises(HardwareError):
        ready.regulator.exchange(np.zeros(ready.n_chambers + 1), ready.now_ns)


def test_vent_is_at_once_and_idempotent(ready):
    ready.run(100, 80e3)
    ready.vent(60)
    assert ready.true_pa().max() < 5e3 * ready.scale + ready.empty_pa
    assert ready.run(100, 30e3).faults == ()
    np.testing.assert_allclose(ready.true_pa(), ready.setpoints(30e3), atol=ready.level_pa)


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
    assert ready.true_pa().max() < ready.empty_pa
    ready.regulator.configure()
    assert ready.run(100, 60e3).faults == ()


def test_close_vents_and_is_idempotent(ready):
    ready.run(100, 80e3)
    ready.regulator.close()
    if ready.scale == 1.0:  # a real device is not read after that
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
