"""The `canopen` package as the other side: of emulated devices, over python-can's slcan, and of the driver.

Driver and emulated devices share one reading of the standard; these tests hold it against another one.
"""

import contextlib
import struct
import time

import canopen
import numpy as np
import pytest
from canopen.sdo import SdoAbortedError
from canopen.sdo.server import SdoServer
from hardware_bench import ONE_VALVE, cycles_in_real_time, driver, emulator, platform, platform_file, wait_for

from soro_core.config import config_folder

EDS = str(config_folder() / "canopen" / "cia408.eds")
HOST = 127


# -- a stock master on the emulated devices --------------------------------------------------------


@pytest.fixture(scope="module")
def bus(tmp_path_factory):
    """A canopen network on python-can's slcan, with the emulated node 1."""
    folder = tmp_path_factory.mktemp("witness")
    path = platform_file(folder, valves=ONE_VALVE, emulation={"boot_delay_s": 0.01})
    with emulator(folder, platform=path) as served:
        network = canopen.Network()
        network.connect(
            interface="slcan", channel=str(served.device), bitrate=1_000_000, sleep_after_open=0.0
        )
        try:
            yield network
        finally:
            network.disconnect()


@pytest.fixture
def node(bus):
    """The node after a reset, in the eyes of the package."""
    remote = bus.add_node(1, EDS)
    remote.emcy.reset()
    remote.sdo.RESPONSE_TIMEOUT = 5.0  # of a machine that others use too
    remote.sdo.MAX_RETRIES = 3
    reset(remote, 0x81)
    yield remote
    bus.sync.stop()
    remote.nmt.stop_node_guarding()


def reset(node, command):
    """Reset the node, or its communication, and wait for its boot-up message."""
    heard = []
    node.nmt.add_heartbeat_callback(heard.append)
    node.nmt.send_command(command)
    wait_for(lambda: 0 in heard)


def register(node):
    return node.sdo[0x1001].raw


def emergency(node, code):
    """Wait for an emergency of this code."""
    return wait_for(lambda: [e for e in node.emcy.log if e.code == code])[0]


@pytest.mark.process
def test_sdo_of_another_library(node):
    assert node.sdo[0x1000].raw & 0xFFFF == 408
    assert node.sdo[0x1018][2].raw == 0x408
    node.sdo[0x1017].raw = 1000
    assert node.sdo[0x1017].raw == 1000
    assert node.sdo[0x6381][1].raw == pytest.approx(0, abs=100)


@pytest.mark.process
@pytest.mark.parametrize(
    ("index", "sub", "data"), [(0x1017, 0, b"\x64\x00"), (0x1016, 1, b"\x64\x00\x7f\x00")]
)
def test_segmented_download_of_a_short_object(node, index, sub, data):
    node.sdo.download(index, sub, data, force_segment=True)
    assert node.sdo.upload(index, sub) == data


@pytest.mark.parametrize(
    ("index", "sub", "data", "code"),
    [
        (0x2000, 0, b"\x00", 0x06020000),
        (0x1018, 9, b"\x00", 0x06090011),
        (0x6041, 0, b"\x00\x00", 0x06010002),
        (0x1017, 0, b"\x00", 0x06070010),
    ],
)
@pytest.mark.parametrize("segmented", [False, True])
def test_refusals(node, index, sub, data, code, segmented):
    with pytest.raises(SdoAbortedError) as caught:
        node.sdo.download(index, sub, data, force_segment=segmented)
    assert caught.value.code == code


def test_heartbeats_and_states(node):
    node.sdo[0x1017].raw = 20
    assert node.nmt.wait_for_heartbeat(2.0) == "PRE-OPERATIONAL"
    for state in ("OPERATIONAL", "STOPPED", "PRE-OPERATIONAL"):
        node.nmt.state = state
        wait_for(lambda state=state: node.nmt.wait_for_heartbeat(2.0) == state)
    reset(node, 0x82)
    assert node.sdo[0x1017].raw == 0


def test_node_guarding(node):
    node.nmt.start_node_guarding(0.02)
    assert node.nmt.wait_for_heartbeat(2.0) == "PRE-OPERATIONAL"
    node.nmt.stop_node_guarding()


def test_maps_and_values_of_pdos(bus, node):
    """The package reads the maps, changes one, and exchanges set point and reading by SYNC."""
    node.rpdo.read()
    node.tpdo.read()
    assert [(v.index, v.subindex) for v in node.rpdo[1]] == [(0x6040, 0), (0x6380, 1)]
    assert [(v.index, v.subindex) for v in node.tpdo[1]] == [(0x6041, 0), (0x6381, 1)]
    pdo = node.tpdo[1]
    pdo.clear()
    pdo.add_variable(0x6381, 1)
    pdo.add_variable(0x6041, 0)
    pdo.trans_type, pdo.enabled = 1, True
    pdo.save()
    heard = []
    pdo.add_callback(lambda received: heard.append((received[0].raw, received[1].raw)))
    node.nmt.state = "OPERATIONAL"
    rpdo = node.rpdo[1]
    for control in (1, 3, 7):
        rpdo[0].raw, rpdo[1].raw = control, 3000
        rpdo.transmit()
        bus.sync.transmit()
        time.sleep(0.02)
    bus.sync.start(0.01)
    wait_for(lambda: heard and heard[-1][1] & 0xF == 0xF and abs(heard[-1][0] - 3000) < 150)


def test_a_lost_host_stands_as_an_error_until_it_is_heard_again(bus, node):
    node.sdo[0x1016][1].raw = HOST << 16 | 50
    node.nmt.state = "OPERATIONAL"
    bus.send_message(0x700 + HOST, b"\x05")
    assert emergency(node, 0x8130).register & 0x10
    node.sdo[0x1017].raw = 20
    node.nmt.state = "OPERATIONAL"
    assert node.nmt.wait_for_heartbeat(2.0) == "PRE-OPERATIONAL", "the error keeps it from starting"
    node.sdo[0x1016][1].raw = HOST << 16 | 5000
    assert register(node) & 0x10
    bus.send_message(0x700 + HOST, b"\x05")
    wait_for(lambda: not register(node) & 0x10)
    node.nmt.state = "OPERATIONAL"
    wait_for(lambda: node.nmt.wait_for_heartbeat(2.0) == "OPERATIONAL")


def test_a_late_sync_stands_as_an_error_until_the_next_one(bus, node):
    node.sdo[0x1006].raw = 20_000
    time.sleep(0.1)
    assert not node.emcy.log, "the watch begins with the first SYNC"
    bus.sync.transmit()
    assert emergency(node, 0x8100).register & 0x10
    bus.sync.transmit()
    assert emergency(node, 0).code == 0


# -- stock nodes as the driver's devices -----------------------------------------------------------


class StockValve:
    """A `canopen.LocalNode` with the least of CiA 408: states, and a reading that is the set point.

    SDO server, NMT, heartbeat, object dictionary and PDO maps are the package's.
    """

    def __init__(self, network):
        self.node = network.create_node(1, EDS)
        self._store(0x6041, 0, "<H", 8)
        self._store(0x6042, 0, "<b", 1)
        self._store(0x6043, 0, "<b", 4)
        for index in (0x6380, 0x6381):
            self._store(index, 1, "<h", 0)
            self._store(index, 2, "<B", 0x22)
            self._store(index, 3, "<b", 1)
        self.node.add_write_callback(self._on_write)
        network.subscribe(0x080, self._on_sync)
        self.node.nmt.send_command(0)  # boot-up
        self.node.nmt.state = "PRE-OPERATIONAL"

    def value(self, index, sub):
        """What an object holds now."""
        return int.from_bytes(self.node.get_data(index, sub), "little")

    def _store(self, index, sub, layout, value):
        self.node.data_store.setdefault(index, {})[sub] = struct.pack(layout, value)

    def _on_write(self, index, subindex, od, data):
        if index == 0x6040:
            self._control(int.from_bytes(data, "little"))
        if index == 0x6040 and data[0] == 1:  # the host has configured the maps
            self.node.rpdo.read()
            self.node.tpdo.read()

    def _control(self, word):
        bits = 0 if not word & 1 else 1 if not word & 2 else 3 if not word & 4 else 7
        self._store(0x6041, 0, "<H", 8 | bits)

    def _on_sync(self, can_id, data, timestamp):
        if self.node.nmt.state != "OPERATIONAL":
            return
        rpdo, tpdo = self.node.rpdo[1], self.node.tpdo[1]
        self._control(rpdo[0].raw)
        tpdo[0].raw, tpdo[1].raw = self.value(0x6041, 0), rpdo[1].raw
        tpdo.transmit()


@contextlib.contextmanager
def stock_bus(name):
    """A canopen network on a bus of python-can within this process."""
    network = canopen.Network()
    network.connect(interface="virtual", channel=name)
    try:
        yield network
    finally:
        network.disconnect()


class InSegments(SdoServer):
    """The package's server, which answers a read of a short object in segments too, as CiA 301 allows."""

    def send_response(self, response):
        command, index, sub = struct.unpack_from("<BHB", response)
        if command & 0xE3 == 0x43:  # expedited, with its size
            size = 4 - (command >> 2 & 3)
            self.left = bytes(response[4 : 4 + size])
            response = struct.pack("<BHBL", 0x41, index, sub, size)
        super().send_response(response)

    def segmented_upload(self, command):
        size = len(self.left)
        super().send_response(bytes([7 - size << 1 | 1]) + self.left.ljust(7, b"\0"))


@pytest.mark.slow
@pytest.mark.parametrize("segmented", [False, True])
def test_the_driver_starts_and_drives_a_stock_node(segmented, monkeypatch):
    if segmented:
        monkeypatch.setattr("canopen.node.local.SdoServer", InSegments)
    patient = platform(
        transport={"kind": "python_can", "interface": "virtual", "channel": "stock"},
        valves=ONE_VALVE,
        cycle_hz=50.0,
        cycle_budget_s=0.1,
        watchdog_test=False,  # a stock node has the objects of the watches, and does not watch
        canopen={
            "heartbeat_s": 0.02,
            "heartbeat_consumer_s": 1.0,
            "rpdo_deadline_s": 0.5,
            "stale_cycles": 50,
            "stale_s": 0.5,
            "sdo_timeout_s": 5.0,
            "mapping": {"supply": None, "tpdos": [{"number": 1, "entries": ["status", "reading"]}]},
        },
    )
    with stock_bus("stock") as network:
        valve = StockValve(network)
        # Of a stock consumer of heartbeats, on the host's.
        host, heard = network.add_node(HOST, EDS), []
        host.nmt.add_heartbeat_callback(heard.append)
        valve.node.add_read_callback(lambda **_: time.sleep(0.005))  # the start-up takes a while
        with driver(patient, "stock", lockstep=False) as regulator:
            during = len(heard)
            assert set(heard) == {5}
            assert during >= 8
            assert valve.node.nmt.state == "OPERATIONAL"
            assert valve.value(0x1016, 1) == HOST << 16 | 1000
            assert valve.value(0x1006, 0) == 0
            assert valve.value(0x63A0, 1) == 9000
            assert valve.value(0x6394, 1) == 0
            assert valve.value(0x6041, 0) & 0xF == 0xB, "HOLD"
            time.sleep(0.1)
            assert len(heard) == during, "no heartbeat between start-up and first exchange"
            results = cycles_in_real_time(regulator, 0.5, np.array([30e3]))
            assert not [fault for result in results for fault in result.faults if fault.latched]
            assert results[-1].pressure_pa == pytest.approx([30e3])
            assert valve.value(0x6041, 0) & 0xF == 0xF
        wait_for(lambda: valve.node.nmt.state == "STOPPED")
        assert valve.value(0x1016, 1) == 0
