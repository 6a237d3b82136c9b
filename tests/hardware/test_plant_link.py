"""Both ends of the plant link in this process."""

import socket
import struct

import numpy as np
import pytest

from soro_core.errors import HardwareError
from soro_core.hardware.plant_link import PlantLinkClient, PlantLinkServer


@pytest.fixture
def server(tmp_path):
    server = PlantLinkServer(tmp_path / "plant")
    yield server
    server.close()


@pytest.fixture
def client(server):
    client = PlantLinkClient(server.path)
    server.accept()
    yield client
    client.close()


def test_frames_come_in_order(server, client):
    for n in range(3):
        server.publish(n * 1000, np.array([1.0, 2.0, n]))
    for n in range(3):
        frame = client.receive(1.0)
        assert (frame.sequence, frame.time_ns) == (n + 1, n * 1000)
        np.testing.assert_array_equal(frame.pressures, [1.0, 2.0, n])


def test_bytes_on_the_socket(server):
    raw = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    raw.connect(str(server.path))
    server.accept()
    server.publish(5_000_000, np.array([100.0, 0.5]))
    assert raw.recv(4096) == b"SPL1" + struct.pack("<IQq2d", 2, 1, 5_000_000, 100.0, 0.5)
    raw.close()


def test_latest(server, client):
    assert client.latest() is None
    for n in range(10):
        server.publish(n, np.array([float(n)]))
    assert client.latest().sequence == 10
    assert client.latest().sequence == 10, "the newest one stays"
    server.publish(99, np.array([7.0]))
    assert client.receive(1.0).time_ns == 99


def test_silence_is_an_error(client):
    with pytest.raises(HardwareError, match=r"no pressures from the emulator for 0\.01 s"):
        client.receive(0.01)


def test_server_that_goes(server, client):
    server.publish(0, np.zeros(2))
    server.close()
    assert client.receive(1.0).sequence == 1, "what was sent is still read"
    with pytest.raises(HardwareError, match="gone"):
        client.receive(1.0)


def test_client_that_goes(server, client):
    client.close()
    for n in range(3):
        server.publish(n, np.zeros(3))
    assert server._clients == {}


def test_slow_client_loses_whole_frames_and_holds_nobody_up(server, client):
    for n in range(20_000):
        server.publish(n, np.full(12, float(n)))
    assert server.dropped > 0
    sequences, last = [], 0
    while True:
        try:
            frame = client.receive(0.05)
        except HardwareError:
            break
        assert frame.pressures[11] == frame.time_ns == frame.sequence - 1
        sequences.append(frame.sequence)
        assert frame.sequence > last
        last = frame.sequence
    assert len(sequences) > 100


def test_no_server(tmp_path):
    with pytest.raises(HardwareError, match="no emulator serves this plant link"):
        PlantLinkClient(tmp_path / "nothing")


def test_socket_left_by_a_killed_server_is_replaced(tmp_path):
    left = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    left.bind(str(tmp_path / "plant"))
    left.close()
    PlantLinkServer(tmp_path / "plant").close()
    assert not (tmp_path / "plant").exists()


def test_file_in_the_way_is_kept(tmp_path):
    (tmp_path / "plant").write_text("mine")
    with pytest.raises(HardwareError, match=r"cannot listen .*\(a file of that name is in the way\)"):
        PlantLinkServer(tmp_path / "plant")
    assert (tmp_path / "plant").read_text() == "mine"


def test_something_else_on_the_socket(tmp_path):
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(str(tmp_path / "plant"))
    listener.listen()
    client = PlantLinkClient(tmp_path / "plant")
    other, _ = listener.accept()
    other.send(b"HTTP/1.1 200 OK, and more than a header")
    with pytest.raises(HardwareError, match="this is no plant link"):
        client.receive(1.0)
    for sock in (client, other, listener):
        sock.close()
