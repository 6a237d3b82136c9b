"""An independent Modbus library that shares no code with ours: pyModbusTCP, on either side.

Driver and emulated terminal both use pymodbus' codec, so that they understand each other proves little. Here
pyModbusTCP's client asks the emulated terminal, and the driver moves a terminal behind pyModbusTCP's server.
pymodbus' client is in test_vtem_tcp.py; its server is not used, since its interface changes with releases.
"""

import contextlib
import socket
import time

import numpy as np
import pytest
from hardware_bench import cycles_in_real_time, driver
from pyModbusTCP.client import ModbusClient
from pyModbusTCP.server import DataBank, ModbusServer
from served_bench import served
from vtem_bench import PLACES, vtem_platform

from soro_core.errors import HardwareError
from soro_hardware import open_regulator
from tests.patience import LIMIT_S
from tests.refused import fails

pytestmark = pytest.mark.process

OUTPUTS, INPUTS, SLOTS = 40003, 45395, 8
RUN_BOTH, RUNS, END, RESTS = 3 << 6 | 3, 2 << 6 | 3, 61, 1 << 6 | 61
TARGET = np.array([20e3, 40e3, 60e3])


class TerminalBank(DataBank):
    """Registers of a terminal whose valves follow at once; slots that it does not have are no registers."""

    def __init__(self, slots: int = SLOTS) -> None:
        super().__init__()
        self._slots = slots
        self.refused: list[int] = []
        self._answer()

    def get_holding_registers(self, address, number=1, srv_info=None):
        if srv_info and not self._has(INPUTS, address, number):
            return self.refused.append(address)
        return super().get_holding_registers(address, number, srv_info)

    def set_holding_registers(self, address, word_list, srv_info=None):
        if srv_info and not self._has(OUTPUTS, address, len(word_list)):
            return self.refused.append(address)
        done = super().set_holding_registers(address, word_list, srv_info)
        if srv_info:
            self._answer()
        return done

    @property
    def set_points(self) -> list[int]:
        """Set points [mbar] of the valves in use."""
        return [self.get_holding_registers(OUTPUTS + 3 * slot + 1 + valve)[0] for slot, valve in PLACES]

    @property
    def commands(self) -> list[int]:
        """Command words of all slots."""
        return self.get_holding_registers(OUTPUTS, 3 * SLOTS)[::3]

    def _has(self, first: int, address: int, number: int) -> bool:
        return first <= address and address + number <= first + 3 * self._slots

    def _answer(self) -> None:
        words = self.get_holding_registers(OUTPUTS, 3 * SLOTS)
        for slot in range(SLOTS):
            command, *wanted = words[3 * slot : 3 * slot + 3]
            runs = command & 0x3F == 3
            super().set_holding_registers(INPUTS + 3 * slot, [RUNS, *wanted] if runs else [RESTS, 0, 0])


@contextlib.contextmanager
def their_server(bank):
    """pyModbusTCP's server with these registers, and its address."""
    with socket.socket() as taken:  # never listens: it keeps the port free for the server
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        server = ModbusServer("127.0.0.1", port, no_block=True, data_bank=bank)
        server.start()
        try:
            yield f"127.0.0.1:{port}"
        finally:
            server.stop()


@pytest.fixture
def client():
    """pyModbusTCP's client on an emulated terminal, and the terminal."""
    with served(vtem_platform()) as (devices, address):
        host, port = address.split(":")
        client = ModbusClient(host, int(port), unit_id=255, timeout=LIMIT_S)
        assert client.open()
        yield client, devices
        client.close()


def until(client, slot, word):
    """Wait for a status word."""
    deadline = time.monotonic() + LIMIT_S
    while client.read_holding_registers(INPUTS + 3 * slot, 1) != [word]:
        assert time.monotonic() < deadline


def test_their_client_moves_a_valve_of_the_emulated_terminal(client):
    client, devices = client
    until(client, 0, RESTS)
    assert client.write_single_register(OUTPUTS, RUN_BOTH)
    until(client, 0, RUNS)
    assert client.write_multiple_registers(OUTPUTS, [RUN_BOTH, 300, 500])
    assert devices.slots[0].outputs == [RUN_BOTH, 300, 500]
    time.sleep(0.5)
    status, *mbar = client.read_holding_registers(INPUTS, 3)
    assert status == RUNS
    np.testing.assert_allclose(mbar, [300, 500], atol=15)
    found = client.write_read_multiple_registers(OUTPUTS, [RUN_BOTH, 0, 0], INPUTS, 3)
    assert found[0] == RUNS
    assert devices.slots[0].outputs == [RUN_BOTH, 0, 0]
    assert client.write_single_register(OUTPUTS, END)
    until(client, 0, RESTS)


def test_their_client_understands_what_the_emulated_terminal_refuses(client):
    client, devices = client
    ways = {
        2: [
            lambda: client.read_holding_registers(1, 3),
            lambda: client.write_single_register(OUTPUTS - 1, 0),
            lambda: client.write_multiple_registers(OUTPUTS + 3 * SLOTS - 1, [0, 0]),
            lambda: client.write_read_multiple_registers(OUTPUTS, [0], 1, 1),
        ],
        1: [
            lambda: client.read_coils(1, 3),
            lambda: client.read_input_registers(INPUTS, 3),
            lambda: client.write_single_coil(1, True),
        ],
    }
    for code, calls in ways.items():
        for call in calls:
            assert not call()
            assert client.last_except == code
    # A byte count that is not that of the registers, past the library's own checks.
    assert client.custom_request(bytes.fromhex("10 9C43 0003 08 00C3 012C 0000")) is None
    assert client.last_except == 3
    assert all(not any(slot.outputs) for slot in devices.slots)


@pytest.mark.parametrize("one_transaction", [False, True])
def test_the_driver_moves_a_terminal_behind_their_server(one_transaction):
    bank = TerminalBank()
    # On a busy machine a process may be off its core for longer than the shipped times allow.
    platform = vtem_platform(
        registers={"one_transaction": one_transaction},
        host={"stale_cycles": 100, "stale_s": 0.5},
        cycle_budget_s=0.1,
    )
    with their_server(bank) as address:
        with driver(platform, address, lockstep=False) as regulator:
            results = cycles_in_real_time(regulator, 0.3, TARGET)
            assert all(result.faults == () for result in results)
            np.testing.assert_array_equal(results[-1].pressure_pa, TARGET)
            assert bank.set_points == [200, 400, 600]
            assert bank.commands == [RUN_BOTH, END, 1 << 6 | 3, 0, 0, 0, 0, 0], "slot 1 feeds nothing"
            regulator.vent()
            cycles_in_real_time(regulator, 0.05, np.zeros(3))
            assert bank.set_points == [0, 0, 0]
            cycles_in_real_time(regulator, 0.1, TARGET)
            statistics = regulator.statistics
            assert statistics.frames_garbled == statistics.frames_refused == 0
        assert bank.set_points == [0, 0, 0]
        assert bank.commands == [END, END, END, 0, 0, 0, 0, 0]
    assert bank.refused == []


def test_a_terminal_with_fewer_slots_is_named_before_any_air():
    bank = TerminalBank(slots=2)
    platform = vtem_platform(host={"supervisor": False})
    with their_server(bank) as address:
        regulator = open_regulator(platform, address)
        with fails(HardwareError, "exception 2", "slots 0 to 2", device="motion terminal", code="refused"):
            regulator.configure()
        regulator.close()
    assert bank.commands == [0] * SLOTS
