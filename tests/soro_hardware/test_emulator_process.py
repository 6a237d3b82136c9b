"""The emulator as a process, over real pseudo-terminals and sockets: lockstep, real time, kills, restarts."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from hardware_bench import (
    PATIENT,
    PERIOD_NS,
    Bench,
    cycles_in_real_time,
    driver,
    driver_process,
    emulator,
    frames_until,
    platform,
    platform_file,
)
from typer.testing import CliRunner

from soro_core.errors import ConfigError, HardwareError
from soro_hardware import load_platform, open_regulator
from soro_hardware.commands.emulate import emulate as emulate_command
from soro_hardware.emulation.process import Emulator, emulate
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient
from tests.refused import fails

TARGET = np.array([20e3, 40e3, 60e3])


def run_lockstep(regulator, link, cycles, first=0):
    """Readings and true pressures of some cycles; set points wander deterministically."""
    inputs = np.random.default_rng(3).uniform(0, 90e3, (cycles, 3))
    rows = []
    for cycle in range(cycles):
        result = regulator.exchange(inputs[cycle], (first + cycle) * PERIOD_NS)
        assert result.faults == ()
        assert result.fresh.all()
        rows.append((result.pressure_pa, link.receive(5.0)))
    return rows


@pytest.mark.process
def test_lockstep_over_a_pseudo_terminal_is_bit_identical(tmp_path):
    def run(number, seed):
        folder = tmp_path / str(number)
        folder.mkdir()
        path = platform_file(folder)
        with (
            emulator(folder, "--lockstep", "--seed", str(seed), platform=path) as served,
            driver(platform(), served.device) as regulator,
        ):
            link = PlantLinkClient(served.plant)
            # The emulator takes the client in its next turn, which comes before the first SYNC.
            regulator.configure()
            rows = run_lockstep(regulator, link, 200)
            link.close()
        assert [frame.sequence for _, frame in rows] == list(range(1, 201))
        assert [frame.time_ns for _, frame in rows] == [5_000_000 * n for n in range(1, 201)]
        return b"".join(p.tobytes() + f.pressures.tobytes() for p, f in rows), regulator.statistics

    assert run(1, 7) == run(2, 7)
    assert run(3, 8)[0] != run(4, 7)[0]


@pytest.mark.process
def test_lockstep_agrees_with_the_emulation_in_this_process(tmp_path):
    """The pseudo-terminal adds nothing and takes nothing away."""
    bench = Bench(platform(), seed=4)
    bench.driver.configure()
    with (
        emulator(tmp_path, "--lockstep", "--seed", "4", platform=platform_file(tmp_path)) as served,
        driver(platform(), served.device) as regulator,
    ):
        for cycle in range(100):
            ours = bench.exchange(*TARGET)
            theirs = regulator.exchange(TARGET, cycle * PERIOD_NS)
            np.testing.assert_array_equal(ours.pressure_pa, theirs.pressure_pa)


@pytest.mark.process
def test_real_time(tmp_path):
    with (
        emulator(tmp_path) as served,
        driver(platform(**PATIENT), served.device, lockstep=False) as regulator,
    ):
        results = cycles_in_real_time(regulator, 1.0, TARGET)
        assert all(result.faults == () for result in results)
        np.testing.assert_allclose(results[-1].pressure_pa, TARGET, atol=1000.0)
        link = PlantLinkClient(served.plant)
        frames = [link.receive(5.0) for _ in range(20)]
        assert np.all(np.diff([frame.time_ns for frame in frames]) == 2_500_000)
        np.testing.assert_allclose(frames[-1].pressures, TARGET, atol=1000.0)
        link.close()
        regulator.close()
        assert regulator.statistics.frames_lost == 0


@pytest.mark.process
def test_valves_vent_when_the_driver_is_killed(tmp_path):
    """SIGKILL: no message is sent any more. The devices notice; a new driver takes them over."""
    path = platform_file(tmp_path, canopen={"heartbeat_consumer_s": 0.2, "rpdo_deadline_s": 0.2})
    with emulator(tmp_path, platform=path) as served:
        with driver_process(path, served.device):
            link = PlantLinkClient(served.plant)
            frames_until(link, lambda frame: frame.pressures[2] > 50e3)
        pressurised = link.latest()
        # World time, not wall time: a busy machine may stop the emulator, not its clock's meaning.
        frames = frames_until(link, lambda frame: frame.pressures.max() < 5e3)
        assert pressurised.pressures.max() > 40e3
        took_s = (frames[-1].time_ns - pressurised.time_ns) * 1e-9
        assert took_s < 0.2 + 0.01 + 0.052 * np.log(60e3 / 5e3) + 0.05
        link.close()
        with driver(platform(**PATIENT), served.device, lockstep=False) as regulator:
            assert all(result.faults == () for result in cycles_in_real_time(regulator, 0.2, TARGET))


@pytest.mark.process
def test_driver_raises_at_once_when_the_emulator_is_killed_and_recovers(tmp_path):
    path = platform_file(tmp_path)
    regulator = open_regulator(platform(), str(tmp_path / "adapter"), lockstep=True)
    with emulator(tmp_path, "--lockstep", platform=path) as served:
        regulator.configure()
        regulator.exchange(TARGET, 0)
        served.unplug()
        with fails(HardwareError, code="gone"):
            regulator.exchange(TARGET, PERIOD_NS)
        regulator.vent()
        with fails(HardwareError, code="open"):
            regulator.configure()
    with emulator(tmp_path, "--lockstep", platform=path):
        regulator.configure()
        assert regulator.exchange(TARGET, 2 * PERIOD_NS).faults == ()
        regulator.close()


@pytest.mark.process
def test_a_host_that_never_reads_does_not_hold_the_devices_up(tmp_path):
    with emulator(tmp_path) as served:
        host = os.open(served.device, os.O_RDWR | os.O_NOCTTY)
        link = PlantLinkClient(served.plant)
        for _ in range(100):
            os.write(host, b"V\r" * 1000)  # 600 kB of answers are far more than any buffer holds
        first = link.receive(5.0)
        frames_until(link, lambda frame: frame.time_ns > first.time_ns + 500_000_000)
        link.close()
        os.close(host)


@pytest.mark.process
def test_ready_line_links_and_clean_end(tmp_path):
    with emulator(tmp_path, "--lockstep") as served:
        path = served.ready.removeprefix("ready: ")
        assert os.readlink(served.device) == path
        assert Path(path).is_char_device()
        assert served.stop() == 0
    assert not list(tmp_path.iterdir()), "links and sockets are taken away"


@pytest.mark.process
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("mode", [[], ["--lockstep"]])
def test_ends_on_a_signal(tmp_path, number, mode):
    with emulator(tmp_path, *mode) as served:
        served.process.send_signal(number)
        assert served.wait() == 0


@pytest.mark.process
def test_old_link_is_replaced_but_no_file(tmp_path):
    (tmp_path / "adapter").symlink_to("/dev/pts/none")
    with emulator(tmp_path, "--lockstep") as served:
        assert os.readlink(served.device).startswith("/dev/pts/")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "adapter").write_text("mine")
    with emulator(tmp_path / "other", "--lockstep") as served:
        assert served.ready == ""
        assert served.wait() == 1
    assert (tmp_path / "other" / "adapter").read_text() == "mine"


@pytest.mark.process
def test_starts_without_numba_or_ros(tmp_path):
    """The emulator and the driver must start quickly."""
    code = (
        "import sys, runpy; sys.argv = ['emulation', '--help']\n"
        "try: runpy.run_module('soro_hardware.emulation', run_name='__main__')\n"
        "except SystemExit: pass\n"
        "import soro_hardware.canopen.driver, soro_hardware.transport.slcan\n"
        "print(*sorted({'numba', 'rclpy', 'scipy', 'matplotlib', 'llvmlite'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "", done.stdout


@pytest.mark.process
def test_module_reports_bad_input_in_one_line(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "soro_hardware.emulation", "nowhere"], capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr.startswith("nowhere: got 'no platforms file of that name'; allowed: ")
    assert len(done.stderr.splitlines()) == 1


def test_command(tmp_path):
    app = typer.Typer()
    app.command()(emulate_command)
    runner = CliRunner()
    shown = runner.invoke(app, ["--help"], env={"COLUMNS": "120", "NO_COLOR": "1", "TERM": "dumb"})
    assert shown.exit_code == 0
    for word in ("PLATFORM", "--lockstep", "--device-link", "--plant-link", "--seed", "ready:"):
        assert word in shown.output
    path = tmp_path / "bad.yaml"
    path.write_text("family: canopen_408\n")
    failed = runner.invoke(app, [str(path)])
    assert isinstance(failed.exception, ConfigError)
    assert f"{path}: valves: got " in str(failed.exception)


def test_the_link_of_a_killed_emulator_of_one_line_gives_way_to_a_folder(tmp_path):
    link = tmp_path / "valves"
    link.symlink_to("/dev/pts/none")
    loaded = load_platform("itv_serial")
    devices = emulate(loaded, True, 0)
    with Emulator(devices, device_link=link):
        assert sorted(path.name for path in link.iterdir()) == ["0", "1", "2"]
    assert not link.exists()


@pytest.mark.parametrize("kind", ["link", "others may write", "file"])
def test_links_are_made_in_a_folder_of_this_user_alone(tmp_path, kind):
    """Whoever could write there would put another device in the place of the valves."""
    link, theirs = tmp_path / "valves", tmp_path / "theirs"
    theirs.mkdir()
    if kind == "others may write":
        link.mkdir()
        link.chmod(0o777)
    elif kind == "file":
        link.write_text("")
    loaded = load_platform("itv_serial")
    devices = emulate(loaded, True, 0)
    if kind == "link":  # given way to, as one that a killed emulator has left, and never followed
        link.symlink_to(theirs)
        with Emulator(devices, device_link=link):
            assert not link.is_symlink()
            assert link.stat().st_mode & 0o777 == 0o700
        assert list(theirs.iterdir()) == []
    else:
        with fails(HardwareError, code="open"):
            Emulator(devices, device_link=link)


@pytest.mark.process
def test_sockets_are_for_this_user_alone(tmp_path):
    loaded = load_platform("emulated_canopen")
    devices = emulate(loaded, True, 0)
    former = os.umask(0)
    try:
        with Emulator(devices, plant_link=tmp_path / "plant", control=tmp_path / "faults"):
            for name in ("plant", "faults"):
                assert (tmp_path / name).stat().st_mode & 0o777 == 0o600
    finally:
        os.umask(former)
