"""`soro board` as a process with its guard, over real sockets, through kills and hangs on both sides."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import typer
from board_bench import BOARD, board_platform, file_of, greeted
from board_process import Bus
from hardware_bench import wait_for
from typer.testing import CliRunner

from soro_core.errors import ConfigError, HardwareError
from soro_hardware import open_regulator
from soro_hardware.board import frames, messages
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.board.pi.server import run_board
from soro_hardware.commands.board import board
from soro_hardware.emulation.board.i2c import EmulatedAds1015, EmulatedMcp4725
from tests.refused import fails

TARGET = np.array([20e3, 40e3, 60e3])
SAFE = 2048
# On a busy machine a process may be off its core for longer than the shipped times allow.
PATIENT = {
    "board": {"watchdog_s": 0.5, "hang_s": 1.0},
    "host": {"heartbeat_consumer_s": 5.0, "stale_cycles": 100, "stale_s": 0.5},
    "cycle_budget_s": 0.1,
}
CLIENT = """
import sys, time
import numpy as np
from soro_hardware import load_platform, open_regulator
regulator = open_regulator(load_platform(sys.argv[1]), sys.argv[2])
regulator.configure()
while True:
    result = regulator.exchange(np.array([20e3, 40e3, 60e3]), time.monotonic_ns())
    if result.faults:
        regulator.configure()
    print("cycle", flush=True)
    time.sleep(0.004)
"""


class Served:
    """The server's process, the guard's in truth, and the log of its DACs."""

    def __init__(self, folder: Path, **changes):
        self.config = file_of(folder, BOARD, **changes)
        self.platform = board_platform(**changes)
        self.log = folder / "dacs.log"
        script = Path(__file__).parent / "board_process.py"
        self.process = subprocess.Popen(
            [sys.executable, script, self.config, self.log],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.lines = []
        for line in self.process.stdout:
            self.lines.append(line.strip())
            if line.startswith("ready: "):
                break
        self.address = self.lines[-1].removeprefix("ready: ")

    @property
    def server_pid(self):
        """The watched process."""
        return int(Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()[0])

    def codes(self):
        """Newest code of every DAC."""
        return {name: code for _, _, name, code in self.entries()}

    def entries(self):
        """Time [ns], process, DAC and code of every change."""
        return [tuple(map(int, line.split())) for line in self.log.read_text().splitlines()]

    def vented_ns(self):
        """When the last DAC went to 0 Pa, or None while one has not."""
        if any(code != SAFE for code in self.codes().values()):
            return None
        return max(entry[0] for entry in self.entries())

    def connect(self):
        """A configured driver."""
        regulator = open_regulator(self.platform, self.address)
        regulator.configure()
        return regulator


@contextlib.contextmanager
def serving(folder, **changes):
    served = Served(folder, **changes)
    try:
        yield served
    finally:
        with contextlib.suppress(ProcessLookupError, IndexError, FileNotFoundError):
            os.kill(served.server_pid, signal.SIGKILL)
        served.process.kill()
        served.process.communicate(timeout=10)


@contextlib.contextmanager
def client(served):
    """A driver in a process of its own that holds pressures."""
    process = subprocess.Popen(
        [sys.executable, "-c", CLIENT, served.config, served.address], stdout=subprocess.PIPE
    )
    try:
        for _ in range(20):
            assert process.stdout.readline() == b"cycle\n"
        yield process
    finally:
        process.kill()
        process.wait(10)
        process.stdout.close()


def cycles(regulator, count):
    """Exchange at 250 Hz; the results."""
    results = []
    for _ in range(count):
        results.append(regulator.exchange(TARGET, time.monotonic_ns()))
        time.sleep(0.004)
    return results


@pytest.fixture
def served(tmp_path):
    """A server that the test may kill."""
    with serving(tmp_path, **PATIENT) as served:
        yield served


@pytest.fixture(scope="module")
def lasting(tmp_path_factory):
    """A server for all tests that leave it alive."""
    with serving(tmp_path_factory.mktemp("board"), **PATIENT) as served:
        yield served


@pytest.mark.process
def test_self_test_is_reported_and_every_port_vented(lasting):
    warning = "the DAC asks for 100.0 kPa after power-up; `soro board --store-safe` mends it"
    assert lasting.lines[:4] == [f"port {n}: ok, 0.0 kPa, {warning}" for n in range(4)]
    assert lasting.codes() == dict.fromkeys(range(4), SAFE)


@pytest.mark.process
def test_exchange(lasting):
    regulator = lasting.connect()
    results = cycles(regulator, 50)
    assert all(result.faults == () for result in results)
    np.testing.assert_allclose(results[-1].pressure_pa, TARGET, atol=200.0)
    assert lasting.codes() == {0: 2458, 1: 2867, 2: 3277, 3: SAFE}
    regulator.close()
    assert wait_for(lasting.vented_ns)


@pytest.mark.process
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_ports_vent_when_the_driver_is_killed_or_hangs(tmp_path, number):
    """Killed: its connection ends. Stopped: it does not, and the watchdog alone is left."""
    delays = []
    with serving(tmp_path, host=PATIENT["host"], board={"hang_s": 1.0}) as served:
        # A machine that is busy for the whole of 150 ms may spoil one attempt, but not three.
        while len(delays) < 3 and min(delays, default=1.0) > 0.15:
            with client(served) as process:
                wait_for(lambda: served.codes()[2] == 3277)
                at_ns = time.monotonic_ns()
                process.send_signal(number)
                delays.append((wait_for(served.vented_ns) - at_ns) * 1e-9)
    assert min(delays) < 0.15, delays


@pytest.mark.process
def test_server_killed(served):
    """The guard vents; the driver says so in its next cycle."""
    regulator = served.connect()
    cycles(regulator, 20)
    killed = served.server_pid
    os.kill(killed, signal.SIGKILL)
    assert wait_for(served.vented_ns)
    assert {pid for _, pid, _, _ in served.entries()} == {killed, served.process.pid}
    result = regulator.exchange(TARGET, time.monotonic_ns())
    assert [fault.code for fault in result.faults if fault.latched] == ["link_lost"]
    assert not result.sent_pa.any()
    assert served.process.wait(10) == 1
    assert "the server was killed by SIGKILL" in served.process.stderr.read()
    regulator.close()


@pytest.mark.process
def test_server_hangs(tmp_path):
    """No set points for the DACs and no watch of the host: the watcher ends the server."""
    with serving(tmp_path, **{**PATIENT, "board": {"watchdog_s": 0.5, "hang_s": 0.3}}) as served:
        regulator = served.connect()
        cycles(regulator, 20)
        os.kill(served.server_pid, signal.SIGSTOP)
        assert wait_for(served.vented_ns)
        assert served.process.wait(10) == 1
        regulator.close()


@pytest.mark.process
def test_guard_killed(served):
    """The server ends with its watcher."""
    regulator = served.connect()
    cycles(regulator, 20)
    served.process.kill()
    assert wait_for(served.vented_ns)
    regulator.close()


@pytest.mark.process
def test_guard_stands_still(served):
    """Nobody would vent after the server: it ends in time, and vents before."""
    regulator = served.connect()
    cycles(regulator, 20)
    served.process.send_signal(signal.SIGSTOP)
    try:
        # What the server does in its last moment may be seen first, as `left_operational`.
        assert wait_for(lambda: "link_lost" in {fault.code for fault in cycles(regulator, 3)[-1].faults})
        assert served.vented_ns()
    finally:
        served.process.send_signal(signal.SIGCONT)
    assert served.process.wait(10) == 1
    assert "the watching process stood still for" in served.process.stderr.read()
    regulator.close()


@pytest.mark.process
def test_a_pressed_stop_vents_and_the_driver_is_told(tmp_path):
    with serving(tmp_path, board={"stop": {"line": 17}, **PATIENT["board"]}, host=PATIENT["host"]) as served:
        regulator = served.connect()
        regulator.exchange(TARGET, time.monotonic_ns())
        assert served.vented_ns() is None
        pressed = served.log.with_name(f"{served.log.name}.pressed")
        pressed.touch()
        assert wait_for(served.vented_ns), "vented without a word of the host"
        faults = regulator.exchange(TARGET, time.monotonic_ns()).faults
        assert [fault.code for fault in faults] == ["stop_pressed"]
        with fails(HardwareError, "contact of the emergency stop is open"):
            regulator.configure()
        pressed.unlink()
        wait_for(lambda: started(regulator))
        regulator.exchange(TARGET, time.monotonic_ns())
        assert wait_for(lambda: served.vented_ns() is None)
        regulator.close()


def started(regulator):
    """Whether the start-up succeeds."""
    try:
        regulator.configure()
    except HardwareError:
        return False
    return True


@pytest.mark.process
def test_terminated(served):
    regulator = served.connect()
    cycles(regulator, 20)
    served.process.terminate()
    assert served.process.wait(10) == 0
    assert served.vented_ns()
    result = regulator.exchange(TARGET, time.monotonic_ns())
    assert {fault.code for fault in result.faults} >= {"left_operational", "link_lost"}
    regulator.close()


@pytest.mark.process
def test_a_guard_that_cannot_vent_says_so():
    """The server dies with a bus on which no chip answers: the DACs hold what they have."""
    script = (
        "import os, sys\nfrom soro_hardware.board.pi.watcher import watched\n"
        "sys.exit(watched(lambda beat: os.kill(os.getpid(), 9), lambda: (1, 3), 1.0))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "NOT ALL VENTED: ports 1, 3 do not answer and hold their voltage" in done.stderr
    assert "the server was killed by SIGKILL" in done.stderr


@pytest.mark.process
def test_garbage_of_a_stranger_does_not_end_it(lasting):
    host, port = lasting.address.split(":")
    rng = np.random.default_rng(5)
    for _ in range(3):
        with (
            socket.create_connection((host, int(port))) as stranger,
            contextlib.suppress(ConnectionResetError, BrokenPipeError),  # it hangs up
        ):
            for _ in range(20):
                stranger.sendall(rng.bytes(1000))
    regulator = lasting.connect()
    assert cycles(regulator, 5)[-1].faults == ()
    regulator.close()


@pytest.mark.process
def test_a_host_that_never_reads_does_not_hold_it_up(lasting):
    host, port = lasting.address.split(":")
    with socket.create_connection((host, int(port))) as deaf:
        number, half = greeted(deaf), messages.pack_set([50_000] * 4)
        for sequence in range(1, 60_000):  # the answers are 4 MB
            deaf.sendall(frames.encode(BoardFrame(FrameType.SET, sequence, half, number)))
        assert wait_for(lambda: lasting.codes()[0] == 3072)
    assert wait_for(lasting.vented_ns)


@pytest.mark.process
def test_needs_no_ros_no_numba_and_no_can():
    code = (
        "import sys, soro_hardware.board.pi.server, soro_hardware.board.driver\n"
        "import soro_hardware.veab.driver, soro_hardware.emulation.veab\n"
        "print(*sorted({'numba', 'rclpy', 'scipy', 'matplotlib', 'can', 'serial'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "\n"


WITHOUT_ROS = """
import sys
for name in ("rclpy", "std_msgs", "sensor_msgs", "smbus2"):
    sys.modules[name] = None
from soro_ros.cli import main
sys.argv = ["soro", "board", "soro_board", "--check"]
main()
"""


@pytest.mark.process
def test_command_without_ros():
    done = subprocess.run([sys.executable, "-c", WITHOUT_ROS], capture_output=True, text=True, check=False)
    assert done.stderr == "soro: the package smbus2 is not installed: pip install 'soro[board]'\n"
    assert done.returncode == 2


def test_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "smbus2", None)
    app = typer.Typer()
    app.command()(board)
    shown = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "120", "NO_COLOR": "1", "TERM": "dumb"})
    assert shown.exit_code == 0
    for word in ("CONFIG", "--listen", "--check", "--store-safe", "ready:"):
        assert word in shown.output
    for arguments, status, text in [
        (["soro_board"], 2, "the package smbus2 is not installed: pip install 'soro[board]'"),
        (["veab_tcp"], 2, "veab_tcp: family: got 'veab_tcp'; allowed: soro_board"),
        (
            ["soro_board", "--listen", "here:x"],
            2,
            "soro board: --listen: got 'here:x'; allowed: HOST or HOST:PORT",
        ),
    ]:
        failed = CliRunner().invoke(app, arguments)
        assert isinstance(failed.exception, ConfigError if status == 2 else HardwareError), "`soro` tells it"
        assert text in str(failed.exception)


def chips_of(platform, stored_code):
    """Buses with the chips of a platform, on this machine's clock."""
    buses = {}
    for port in platform.ports:
        dac = EmulatedMcp4725(stored_code)
        adc = EmulatedAds1015(lambda dac=dac: 2.0 * dac.fraction)
        buses.setdefault(port.bus, Bus({})).chips.update({port.dac: dac, port.adc: adc})
    return buses


def test_check_and_store_safe(tmp_path):
    config, buses, lines = file_of(tmp_path, BOARD), chips_of(board_platform(), 4095), []

    def run(**options):
        lines.clear()
        return run_board(config, "", lines.append, open_bus=buses.__getitem__, **options)

    assert run(check=True) == 0
    assert all("100.0 kPa after power-up" in line for line in lines)
    assert run(check=True, store_safe=True) == 0
    assert lines == [f"port {n}: ok, 0.0 kPa" for n in range(4)]
    buses[3].chips[0x61].power_up()
    assert buses[3].chips[0x61].code == SAFE
    del buses[3].chips[0x49]
    assert run(check=True) == 1
    assert lines[3] == "port 3: FAILED, ADC 0x49: ENXIO"


def test_bus_that_is_not_there(tmp_path):
    def open_bus(number):
        raise HardwareError("cannot open", f"/dev/i2c-{number}", "open")

    with fails(HardwareError, device="/dev/i2c-1", code="open"):
        run_board(file_of(tmp_path, BOARD), "", print, open_bus=open_bus)
