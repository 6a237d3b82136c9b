"""The motion terminal over TCP: peers that misbehave, another maker's client, kills, what the doctor says."""

import contextlib
import socket
import threading
import time

import numpy as np
import pytest
from board_bench import file_of
from hardware_bench import cycles_in_real_time, driver_process, emulator, frames_until
from pymodbus.client import ModbusTcpClient
from served_bench import served
from vtem_bench import VTEM, vtem_platform

from soro_core.errors import HardwareError
from soro_hardware import doctor, load_platform, open_regulator
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient
from soro_hardware.vtem.client import Client
from soro_hardware.vtem.driver import check_speed
from soro_hardware.vtem.modbus import LAST_TRANSACTION
from soro_hardware.vtem.registers import SlotState, command
from tests.patience import LIMIT_S
from tests.refused import fails


@contextlib.contextmanager
def peer(text):
    """A server that sends something to each host, again and again, or nothing."""
    done = threading.Event()

    def serve(connection):
        connection.settimeout(0.1)
        with connection, contextlib.suppress(ConnectionError):
            while not done.wait(0.0 if text else 0.1):
                with contextlib.suppress(TimeoutError):
                    connection.sendall(text)

    def accept(listener):
        listener.settimeout(0.1)
        while not done.is_set():
            with contextlib.suppress(TimeoutError):
                threading.Thread(target=serve, args=(listener.accept()[0],), daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=accept, args=(listener,))
        thread.start()
        yield "{}:{}".format(*listener.getsockname())
        done.set()
        thread.join()


@pytest.mark.process
@pytest.mark.timeout(120)
@pytest.mark.parametrize(
    "text", [b"", bytes.fromhex("0001 0000 0005 FF 03 02 0000") * 5000], ids=["silent", "endless"]
)
def test_a_peer_that_never_answers_or_never_stops_holds_nobody(text, tmp_path):
    """From the start, or after a start-up: another device under the same address."""
    platform, where = vtem_platform(host={"supervisor": False}), tmp_path / "terminal"
    with peer(text) as address, served(platform) as (_, right):
        impatient = open_regulator(vtem_platform(host={"answer_timeout_s": 0.1}), address)
        with fails(HardwareError, step="start-up") as caught:
            impatient.configure()
        assert caught.value.code in ({"silent", "flood"} if text else {"silent"})
        impatient.close()
        where.symlink_to(right)
        regulator = open_regulator(platform, str(where))
        regulator.configure()
        where.unlink()
        where.symlink_to(address)
        regulator.link.open()
        codes = set()
        for cycle in range(10):
            result = regulator.exchange(np.zeros(3), cycle * 10_000_000)
            regulator.vent()
            assert not result.fresh.any()
            codes |= {fault.code for fault in result.faults}
        assert codes >= ({"stale_reading", "link_lost"} if text else {"stale_reading"})
        regulator.close()


@pytest.mark.parametrize("text", [b"", b"\x00\x09\x00\x00\x00\x05\xff\x03\x02\x00\x00", b"\xff" * 9])
def test_a_transaction_ends_at_its_deadline(text):
    class Link:
        is_open, now_s, drains = True, 0.0, 0

        def send(self, data):
            self.drains = 0

        def receive(self, timeout_s):
            self.now_s += max(min(timeout_s, 0.001), 1e-6) if text else timeout_s
            self.drains += 1
            return text if timeout_s or self.drains > 5 else b""

    link = Link()
    client = Client(link, 255, lambda: link.now_s)
    assert client.read(45395, 3, 0.004) is None
    assert 0.004 <= link.now_s < 0.006


@pytest.mark.process
def test_another_maker_of_modbus_is_understood_and_understands():
    """pymodbus' own client against the emulated node; the frames are its, not ours."""
    with served(vtem_platform()) as (devices, address):
        host, port = address.split(":")
        client = ModbusTcpClient(host, port=int(port), timeout=LIMIT_S, retries=0)
        assert client.connect()
        at = 40003
        assert client.write_register(at, command(3, 3), device_id=255).registers == [0xC3]
        deadline = time.monotonic() + LIMIT_S
        while (found := client.read_holding_registers(45395, count=3, device_id=255)).registers[0] != 0x83:
            assert time.monotonic() < deadline
        assert client.write_registers(at, [0xC3, 300, 0], device_id=255).count == 3
        both = client.readwrite_registers(
            read_address=45395, read_count=3, write_address=at, values=[0xC3, 300, 200], device_id=255
        )
        assert both.registers[0] == 0x83
        assert devices.slots[0].outputs == [0xC3, 300, 200]
        assert client.read_holding_registers(1, count=3, device_id=255).exception_code == 2
        assert client.read_coils(1, count=3, device_id=255).exception_code == 1
        client.close()
    assert len(found.registers) == 3


@pytest.mark.process
def test_the_process_beside_it_vents_when_the_driver_is_killed(tmp_path):
    host = {"stale_cycles": 100, "stale_s": 0.5, "answer_timeout_s": 5.0}
    path = file_of(tmp_path, VTEM, host=host, cycle_budget_s=0.1)
    with emulator(tmp_path, platform=path) as emulated:
        plant = PlantLinkClient(emulated.plant)
        with driver_process(path, emulated.device):
            frames_until(plant, lambda frame: frame.pressures[2] > 55e3)
        frames_until(plant, lambda frame: frame.pressures.max() < 5e3)
        plant.close()
        # Its own death is a fault, and the next start-up brings another.
        regulator = open_regulator(load_platform(path), str(emulated.device))
        regulator.configure()
        assert cycles_in_real_time(regulator, 0.1, [20e3] * 3)[-1].faults == ()
        until, codes = time.monotonic() + LIMIT_S, set()
        while "supervisor_lost" not in codes:
            assert time.monotonic() < until
            time.sleep(0.5)  # silent with pressure in the arm
            codes = {fault.code for fault in cycles_in_real_time(regulator, 0.05, [20e3] * 3)[-1].faults}
        regulator.configure()
        assert cycles_in_real_time(regulator, 0.1, [20e3] * 3)[-1].faults == ()
        regulator.close()


@pytest.mark.process
def test_doctor_reads_slots_and_speed_and_commands_nothing():
    platform = vtem_platform(cycle_budget_s=0.05, cycle_hz=20.0)
    with served(platform) as (devices, address):
        devices.slots[2].fail(True)
        until = time.monotonic() + LIMIT_S
        while devices.slots[0].status.state is not SlotState.READY:  # it boots
            assert time.monotonic() < until
            time.sleep(0.01)
        found = {finding.name: finding for finding in doctor.examine(platform, address, run_s=0.0)}
        assert all(not any(slot.outputs) for slot in devices.slots)
        wrong = vtem_platform(registers={"inputs": 1000})
        lost = {finding.name: finding for finding in doctor.examine(wrong, address, run_s=0.0)}
    assert found["link0/chamber0, link0/chamber1 (slot 0)"].level == "ok"
    assert found["link0/chamber2 (slot 2)"].level == "fail"
    assert "at most of 50; a cycle has 40.0 ms for 2" in found["speed"].found
    assert "registers.inputs" in lost["motion terminal"].do
    gone = {finding.name: finding for finding in doctor.examine(platform, "127.0.0.1:9", run_s=0.0)}
    assert gone["motion terminal"].level == "fail"
    assert "127.0.0.1:9" in gone["motion terminal"].found
    assert list(gone)[-1] == "motion terminal", "what comes later is left out"


@pytest.mark.parametrize(
    ("one_transaction", "worst_s", "level"),
    [(False, 0.019, "ok"), (False, 0.021, "warn"), (True, 0.039, "ok"), (True, 0.041, "warn")],
)
def test_an_answer_that_a_cycle_has_no_time_for_is_warned_of(one_transaction, worst_s, level):
    platform = vtem_platform(
        cycle_budget_s=0.05, cycle_hz=20.0, registers={"one_transaction": one_transaction}
    )
    assert check_speed(platform, [0.001, worst_s, 0.002]).level == level


def test_a_vent_is_sent_to_a_peer_that_never_stops():
    class Link:
        is_open, sent = True, b""

        def send(self, data):
            self.sent += data

        def receive(self, timeout_s):
            return b"\xff" * 1000

        def close(self):
            self.is_open = False

    link = Link()
    with fails(HardwareError, code="flood"):
        Client(link, 255, lambda: 0.0).post(40003, [0xC3, 0, 0])
    assert link.sent.endswith(bytes.fromhex("C3 0000 0000"))
    assert not link.is_open


def test_transactions_never_are_that_of_the_last_vent(monkeypatch):
    """That of the supervisor's messages: of all numbers the last, here of three."""
    plan = open_regulator(vtem_platform(), "127.0.0.1:1").vent_plan()
    last = LAST_TRANSACTION.to_bytes(2, "big")
    assert all(step["send"].encode("latin-1").startswith(last) for step in plan.steps)
    monkeypatch.setattr("soro_hardware.vtem.client.LAST_TRANSACTION", 3)

    class Link:
        is_open, sent = True, []

        def send(self, data):
            self.sent.append(int.from_bytes(data[:2], "big"))

        def receive(self, timeout_s):
            return b""

    ours = Client(Link(), 255, lambda: 0.0)
    for _ in range(5):
        ours.read(45395, 3, 0.0)
    assert Link.sent == [1, 2, 1, 2, 1]
