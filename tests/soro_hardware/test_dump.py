"""A dump valve that works and some that do not, on emulated air; in lockstep, so that no second passes."""

import json

import numpy as np
import pytest
import typer
from board_bench import BoardBench, board_platform
from hardware_bench import ONE_VALVE, emulator, platform_file
from hil_bench import NAMES, OnAir, OnCan, platform
from typer.testing import CliRunner

from soro_core.errors import ConfigError
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_hardware.emulation.sockets.control import ControlClient
from soro_hardware.hil.dump import DumpConfig, dump_limits, prove
from soro_hardware.hil.paced import PacedRegulator
from soro_ros.commands.doctor import doctor
from tests.refused import refused

CONFIG = DumpConfig(wait_s=3.0)
OPEN = "fault: dump_valve_open"


def on_air():
    devices = OnAir(platform())
    return platform(), devices, devices


def on_can():
    devices = OnCan(platform())
    return platform(), devices, devices.driver


def on_board():
    """A board that reads the contact of the stop."""
    bench = BoardBench(board_platform(board={"stop": {"line": 17}}))
    return bench.driver.platform, bench.devices, bench.driver


class Examined:
    """A proof at the second chamber; `opens` are faults that begin when the operator is told to open it."""

    def __init__(self, *opens, before=(), kind=on_air, config=CONFIG, stop_at=None):
        described, self.devices, driver = kind()
        driver.configure()
        for fault in before:
            self.devices.faults.add(read_injection(fault))
        self.told, self.why, self.cycles, self.true_pa = [], None, 0, []

        def why_stopped():
            return self.why

        guarded = PacedRegulator(
            described, driver, dump_limits(described, config), True, why_stopped=why_stopped
        )

        def cycle(wanted_pa, run=guarded.cycle):
            self.cycles += 1
            sample = run(wanted_pa)
            self.true_pa.append(self.devices.pressure_pa.copy())
            return sample

        guarded.cycle = cycle

        def tell(text):
            self.told.append(text)
            for fault in opens:
                if fault == "stop":
                    self.why = "stop pressed: /safety/stop says so"
                else:
                    self.devices.faults.add(read_injection(fault))

        def stopped():
            return stop_at is not None and self.cycles >= stop_at

        self.finding = prove(config, NAMES[1], 1, guarded, tell, stopped)
        self.cause = guarded.cause
        self.limited = guarded


@pytest.mark.parametrize("kind", [on_air, on_can, on_board])
def test_a_dump_valve_that_works(kind):
    it = Examined(OPEN, kind=kind)
    assert it.finding.level == "ok", it.finding
    assert it.finding.name == f"dump valve at {NAMES[1]}"
    assert "although the regulator was commanded to hold 8.0 kPa" in it.finding.found
    assert len(it.told) == 1
    highest = np.max(it.true_pa, axis=0)
    assert 7e3 < highest[1] < 9e3
    assert highest[[0, 2]].max() < 600.0, "one chamber alone"
    assert it.cause == "the dump valve is examined"


@pytest.mark.parametrize(
    ("opens", "before", "says"),
    [
        ((OPEN,), ("fault: dump_valve_stuck",), "after 3 s: it was not opened, or does not open"),
        ((), (), "it was not opened"),
        # As a dump valve that lets little through: the regulator makes up for it.
        ((f"fault: leak, rate_1_s: 20, chamber: {NAMES[1]}",), (), "kPa 2 s after the first fall"),
        ((f"{OPEN}, duration_s: 0.3",), (), "kPa again"),
        (("stop",), (), "stop pressed: /safety/stop says so: vented by the valves; nothing is proved"),
        ((f"fault: stuck_open, chamber: {NAMES[1]}",), (), "over-pressure"),
        ((), (f"fault: stuck_closed, chamber: {NAMES[1]}",), "at set point 8.0 kPa; nothing is proved"),
        ((), (f"fault: stuck_at, chamber: {NAMES[1]}, pressure_pa: 6e3",), "at rest; nothing is proved"),
        ((), (OPEN,), "at set point 8.0 kPa; nothing is proved"),
    ],
)
def test_what_is_no_proof(opens, before, says):
    it = Examined(*opens, before=before)
    assert it.finding.level == "fail"
    assert says in it.finding.found
    assert it.finding.do
    assert it.limited.cause is not None


def test_a_stop_that_is_an_input_tells_how_to_open_the_valve_alone():
    assert "pull its plug" in Examined("stop").finding.do


def test_a_pressed_stop_that_the_board_reads_is_no_proof():
    """The valves vent too, a moment later than the dump valve."""
    it = Examined("fault: stop_pressed", kind=on_board)
    assert it.finding.level == "fail"
    assert it.finding.found.startswith("stop_pressed: board: ")
    assert "pull its plug" in it.finding.do


def test_an_interruption_vents():
    it = Examined(stop_at=200)
    assert it.cause == "interrupted"
    assert "interrupted: vented" in it.finding.found


def test_a_pressure_beyond_the_range_is_refused():
    low = platform().range.model_copy(update={"maximum_pa": 10e3})
    with refused("pressure_pa", 20e3):
        dump_limits(platform().model_copy(update={"range": low}), DumpConfig(pressure_pa=20e3))


@pytest.fixture(scope="module")
def device(tmp_path_factory):
    """A platform of one valve, its device, and a way to its faults."""
    folder = tmp_path_factory.mktemp("devices")
    described = platform_file(folder, valves=ONE_VALVE)
    with emulator(folder, "--lockstep", "--control", str(folder / "control"), platform=described) as served:
        client = ControlClient(folder / "control")
        yield described, str(served.device), client
        client.close()


def call(described, *options, **given):
    app = typer.Typer()
    app.command()(doctor)
    done = CliRunner().invoke(app, [described, *options], **given)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


@pytest.mark.process
@pytest.mark.parametrize(
    ("before", "status", "level"), [("", 0, "ok"), ("fault: dump_valve_stuck", 1, "fail")]
)
def test_doctor_with_pressure(device, before, status, level):
    described, address, client = device
    for fault in filter(None, (before, f"{OPEN}, at: 3")):
        client.inject(read_injection(fault))
    done = call(described, "--device", address, "--dump", "--yes", "--json", "--lockstep", "--wait", "5s")
    client.inject(read_injection("fault: clear"))
    assert done.exit_code == status, done.output
    (finding,) = json.loads(done.stdout)
    assert finding["level"] == level
    assert "press the emergency stop" in done.stderr


def test_doctor_asks_before_any_pressure(device):
    described, address, _ = device
    done = call(described, "--device", address, "--dump", "--lockstep", input="n\n")
    assert done.exit_code == 1
    assert "8 kPa in link0/chamber0" in done.stderr
    assert "holds" not in done.stderr


@pytest.mark.process
def test_doctor_refuses_a_chamber_that_is_none(device):
    with pytest.raises(ConfigError) as caught:
        call(device[0], "--device", device[1], "--dump", "--chamber", "link9/chamber0")
    assert (caught.value.key, caught.value.got) == ("--chamber", "link9/chamber0")
