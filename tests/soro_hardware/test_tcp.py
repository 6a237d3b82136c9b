"""TCP: the link alone, and both families over real sockets against `soro emulate`."""

import contextlib
import os
import socket
import threading
import time

import numpy as np
import pytest
from board_bench import BOARD, VEAB, BoardBench, VeabBench, board_platform, file_of, veab_platform
from hardware_bench import (
    PERIOD_NS,
    cycles_in_real_time,
    driver,
    driver_process,
    emulator,
    frames_until,
    merged,
)

from soro_core.errors import HardwareError
from soro_hardware import load_platform, open_regulator
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient
from soro_hardware.transport.tcp import TcpLink
from soro_hardware.veab.driver import VeabRegulator
from tests.patience import LIMIT_S
from tests.refused import fails

pytestmark = pytest.mark.process

TARGET = np.array([20e3, 40e3, 60e3])
FAMILIES = {"soro_board": (BOARD, board_platform, BoardBench), "veab_tcp": (VEAB, veab_platform, VeabBench)}
# On a busy machine a process may be off its core for longer than the shipped times allow.
PATIENT = {
    "soro_board": {
        "board": {"watchdog_s": 0.5},
        "host": {"heartbeat_consumer_s": 5.0, "stale_cycles": 100, "stale_s": 0.5},
        "cycle_budget_s": 0.1,
    },
    "veab_tcp": {"host": {"stale_cycles": 100, "stale_s": 0.5, "keep_alive_s": 0.2}, "cycle_budget_s": 0.1},
}


class Clock:
    """Time that stands still unless it is told."""

    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def listener():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener


def address(listener):
    return "{}:{}".format(*listener.getsockname())


@pytest.fixture
def pair(listener):
    """A link, and the socket at its other end."""
    link = TcpLink(address(listener), 1.0, time.monotonic)
    link.open()
    peer, _ = listener.accept()
    yield link, peer
    link.close()
    peer.close()


def test_bytes_both_ways(pair):
    link, peer = pair
    assert link.receive(0.0) == b""
    link.send(b"there")
    assert peer.recv(100) == b"there"
    peer.sendall(b"back")
    assert link.receive(5.0) == b"back"
    with socket.socket(fileno=os.dup(link.fileno())) as same:
        assert same.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) != 0


def test_other_side_closes(pair):
    link, peer = pair
    peer.close()
    with fails(HardwareError, "closed by the other side", device=link.address, code="gone"):
        link.receive(5.0)
    assert not link.is_open
    with fails(HardwareError, device=link.address, code="gone"):
        link.send(b"x")
    link.close()


def test_other_side_takes_no_more(pair):
    link, _ = pair
    with fails(HardwareError, device=link.address, code="gone"):
        link.send(bytes(50_000_000))
    assert not link.is_open


@pytest.mark.parametrize(
    ("bad", "code"),
    [
        ("nowhere", "setting"),
        ("127.0.0.1:port", "setting"),
        ("/no/such/link", "setting"),
        ("127.0.0.1:1", "open"),
    ],
)
def test_address_that_does_not_answer(bad, code):
    with fails(HardwareError, device=bad, code=code):
        TcpLink(bad, 1.0, time.monotonic).open()


def test_a_port_beyond_the_last_is_not_another_one(listener):
    """Sockets take numbers modulo 65536."""
    host, port = address(listener).split(":")
    with fails(HardwareError, "65535", code="setting"):
        TcpLink(f"{host}:{int(port) + 65536}", 1.0, time.monotonic).open()


def test_address_in_a_link(listener, tmp_path):
    name = tmp_path / "board"
    name.symlink_to(address(listener))
    link = TcpLink(str(name), 1.0, time.monotonic)
    link.open()
    link.close()


def test_attempts_to_reconnect_come_at_growing_intervals(listener, monkeypatch):
    clock, attempts = Clock(), []
    link = TcpLink(address(listener), 1.0, clock)
    link.open()
    listener.accept()[0].close()
    listener.close()
    with pytest.raises(HardwareError):
        link.receive(5.0)

    def connect(sock, where, connect=socket.socket.connect):
        attempts.append(round(clock.now, 3))
        connect(sock, where)

    monkeypatch.setattr(socket.socket, "connect", connect)
    while clock.now < 8.0:
        assert not link.reconnect()
        clock.now += 0.005
    waits = np.diff([0.0, *attempts])
    np.testing.assert_allclose(waits, [0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0], atol=0.03)


def test_reconnects(listener):
    clock = Clock()
    link = TcpLink(address(listener), 1.0, clock)
    link.open()
    for _ in range(3):  # nothing has come in between, so the pause grows
        listener.accept()[0].close()
        with pytest.raises(HardwareError):
            link.receive(5.0)
        assert not link.reconnect(), "not at once"
        clock.now += 1.0
        deadline = time.monotonic() + LIMIT_S
        while not link.reconnect() and time.monotonic() < deadline:
            pass
        assert link.is_open
    peer, _ = listener.accept()
    peer.sendall(b"x")
    assert link.receive(5.0) == b"x"
    peer.close()
    link.close()


# -- against the emulator's process ----------------------------------------------------------------


@pytest.mark.parametrize("family", FAMILIES)
def test_lockstep_over_tcp_agrees_with_the_emulation_in_this_process(tmp_path, family):
    base, make, bench_of = FAMILIES[family]
    bench = bench_of(make(), seed=4)
    bench.driver.configure()
    with (
        emulator(tmp_path, "--lockstep", "--seed", "4", platform=file_of(tmp_path, base)) as served,
        driver(make(), served.device) as regulator,
    ):
        assert served.ready.startswith("ready: 127.0.0.1:")
        link = PlantLinkClient(served.plant)
        regulator.configure()  # a start-up is no cycle: the twin must not run ahead
        for cycle in range(1, 101):
            ours, theirs = bench.exchange(*TARGET), regulator.exchange(TARGET, cycle * PERIOD_NS)
            np.testing.assert_array_equal(ours.pressure_pa, theirs.pressure_pa)
            assert theirs.faults == ()
            frame = link.receive(5.0)
            assert (frame.sequence, frame.time_ns) == (cycle, cycle * PERIOD_NS)
            np.testing.assert_array_equal(frame.pressures, bench.devices.pressure_pa)
        link.close()


@pytest.mark.parametrize("family", FAMILIES)
def test_real_time(tmp_path, family):
    path = file_of(tmp_path, FAMILIES[family][0], **PATIENT[family])
    with (
        emulator(tmp_path, platform=path) as served,
        driver(load_platform(path), served.device, lockstep=False) as regulator,
    ):
        results = cycles_in_real_time(regulator, 0.4, TARGET)
        assert all(result.faults == () for result in results)
        np.testing.assert_allclose(results[-1].pressure_pa, TARGET, atol=1000.0)
        plant = PlantLinkClient(served.plant)
        regulator.close()
        assert np.abs(plant.latest().pressures).max() < 5e3
        plant.close()


@pytest.mark.parametrize("family", FAMILIES)
def test_emulator_killed_and_started_again(tmp_path, family):
    base, make, _ = FAMILIES[family]
    path = file_of(tmp_path, base)
    regulator = open_regulator(make(), str(tmp_path / "adapter"), lockstep=True)
    with emulator(tmp_path, "--lockstep", platform=path) as served:
        regulator.configure()
        assert regulator.exchange(TARGET, 0).faults == ()
        served.process.kill()
        served.process.wait(10)
        result = regulator.exchange(TARGET, PERIOD_NS)
        assert [fault.code for fault in result.faults if fault.latched] == ["link_lost"]
        regulator.vent()
        with fails(HardwareError, code="open"):
            regulator.configure()
    with emulator(tmp_path, "--lockstep", platform=path):
        regulator.configure()
        assert regulator.exchange(TARGET, 2 * PERIOD_NS).faults == ()
        regulator.close()


def test_the_keeper_vents_and_keeps_the_server_alive_while_nobody_exchanges(tmp_path):
    """The published server ends after 0.5 s of silence, and holds."""
    path = file_of(tmp_path, VEAB, **PATIENT["veab_tcp"])
    with (
        emulator(tmp_path, platform=path) as served,
        driver(load_platform(path), served.device, lockstep=False) as regulator,
    ):
        time.sleep(0.7)
        assert cycles_in_real_time(regulator, 0.3, TARGET)[-1].faults == (), (
            "0 Pa was held: nothing to trip for"
        )
        time.sleep(0.9)
        plant = PlantLinkClient(served.plant)
        assert np.abs(plant.receive(5.0).pressures).max() < 5e3
        plant.close()
        result = regulator.exchange(TARGET, time.monotonic_ns())
        assert [fault.code for fault in result.faults if fault.latched] == ["watchdog_vented"]
        regulator.configure()
        assert cycles_in_real_time(regulator, 0.1, TARGET)[-1].faults == ()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_dead_keeper_is_noticed_in_the_next_cycle(tmp_path):
    class Link(TcpLink):
        is_deadly = False

        def receive(self, timeout_s):
            if self.is_deadly and threading.current_thread().name == "veab keeper":
                raise RuntimeError("as by an error of the program")
            return super().receive(timeout_s)

    path = file_of(tmp_path, VEAB, **PATIENT["veab_tcp"])
    with emulator(tmp_path, platform=path) as served:
        link = Link(str(served.device), 5.0, time.monotonic)
        regulator = VeabRegulator(load_platform(path), link, time.monotonic)
        with contextlib.closing(regulator):
            regulator.configure()
            (keeper,) = (thread for thread in threading.enumerate() if thread.name == "veab keeper")
            link.is_deadly = True
            keeper.join(LIMIT_S)
            result = regulator.exchange(TARGET, time.monotonic_ns())
            assert [fault.code for fault in result.faults if fault.latched] == ["device_error"]


CASES = {
    "soro_board": ("soro_board", {}, True),
    "veab_tcp": ("veab_tcp", {}, True),
    "veab_tcp alone": ("veab_tcp", {"host": {"supervisor": False}}, False),
}


@pytest.mark.parametrize(("family", "change", "vents"), CASES.values(), ids=CASES.keys())
def test_host_killed(tmp_path, family, change, vents):
    """Our board vents by itself, the published server through the process beside the driver, or never."""
    base, make, _ = FAMILIES[family]
    path = file_of(tmp_path, base, **merged(PATIENT[family], change))
    with emulator(tmp_path, platform=path) as served:
        plant = PlantLinkClient(served.plant)
        with driver_process(path, served.device):
            frames_until(plant, lambda frame: frame.pressures[2] > 55e3)
        killed_ns = plant.latest().time_ns
        # Detected within 0.3 s and fallen from 60 to 5 kPa in 0.13 s; time of the valves, not of the machine.
        while (frame := plant.receive(5.0)).time_ns < killed_ns + 430_000_000:
            pass
        plant.close()
        assert bool(frame.pressures.max() < 5e3) is vents
        assert open_regulator(make(), str(served.device)).device_watchdog is (family == "soro_board")


def test_supervisor_of_the_published_server(tmp_path):
    """It ends with an orderly driver; its own death is a fault."""
    path = file_of(tmp_path, VEAB, **PATIENT["veab_tcp"])
    with emulator(tmp_path, platform=path) as served:
        with driver(load_platform(path), served.device, lockstep=False) as regulator:
            supervisor = regulator.supervisor
            assert cycles_in_real_time(regulator, 0.1, TARGET)[-1].faults == ()
            assert supervisor.is_alive
        assert supervisor.process.wait(10) == 0
        served.process.kill()
    with (
        emulator(tmp_path, platform=path) as served,
        driver(load_platform(path), served.device, lockstep=False) as regulator,
    ):
        regulator.supervisor.process.kill()
        regulator.supervisor.process.wait(10)
        result = regulator.exchange(TARGET, time.monotonic_ns())
        assert [fault.code for fault in result.faults if fault.latched] == ["supervisor_lost"]
        regulator.configure()  # a reset starts another one
        assert regulator.supervisor.is_alive
