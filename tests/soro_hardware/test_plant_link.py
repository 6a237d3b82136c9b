"""Both ends of the plant link in this process."""

import math
import selectors
import socket
import struct
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from soro_core.errors import HardwareError
from soro_core.pneumatics import ValveAction, ValveCondition, healthy
from soro_hardware.emulation.sockets import plant_server
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient
from soro_hardware.emulation.sockets.plant_server import PlantLinkServer
from tests.refused import fails


class Served(PlantLinkServer):
    """A server with its loop, turned by hand."""

    def __init__(self, path, **keys):
        self.path, self.present, self.loop = path, np.array([7.0, 8.0, 9.0]), selectors.SelectSelector()
        super().__init__(path, lambda: self.present, self.loop, **keys)

    @property
    def connections(self):
        return len(self.loop.get_map()) - 1  # without the socket that waits for them

    def turn(self):
        while ready := self.loop.select(0):
            for key, _ in ready:
                key.data()

    def join(self, client, moves_air=True):
        """What `client.join` gives, or raises, while the loop goes round."""
        with ThreadPoolExecutor(1) as pool:
            asked = pool.submit(client.join, moves_air, 2.0)
            while not asked.done():
                self.turn()
        return asked.result()

    def close(self):
        if self.loop.get_map() is not None:
            super().close()
            self.loop.close()


@pytest.fixture
def server(tmp_path):
    server = Served(tmp_path / "plant")
    yield server
    server.close()


@pytest.fixture
def in_lockstep(tmp_path, monkeypatch):
    monkeypatch.setattr(plant_server, "_ANSWER_S", 0.1)
    server = Served(tmp_path / "plant", lockstep=True)
    yield server
    server.close()


def connected(server):
    client = PlantLinkClient(server.path)
    server.turn()
    return client


@pytest.fixture
def client(server):
    client = connected(server)
    yield client
    client.close()


def publish(server, time_ns, pressures, action=None):
    server.publish(
        time_ns, np.asarray(pressures, dtype=float), action or ValveAction((), healthy(len(pressures)))
    )


@pytest.mark.process
def test_frames_come_in_order(server, client):
    for n in range(3):
        publish(server, n * 1000, [1.0, 2.0, n])
    for n in range(3):
        frame = client.receive(1.0)
        assert (frame.sequence, frame.time_ns) == (n + 1, n * 1000)
        np.testing.assert_array_equal(frame.pressures, [1.0, 2.0, n])


@pytest.mark.process
def test_bytes_on_the_socket(server):
    raw = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    raw.connect(str(server.path))
    server.turn()
    condition = ValveCondition(
        *(np.array(row) for row in ([1.0, 0.5], [1.0, 0.0], [math.inf, 2e4], [0, 3], [0, 1]))
    )
    action = ValveAction(((0.001, np.array([10.0, 20.0])), (0.004, np.array([30.0, 40.0]))), condition)
    publish(server, 5_000_000, [100.0, 0.5], action)
    values = [100.0, 0.5, 1.0, 0.5, 1.0, 0.0, math.inf, 2e4, 0, 3, 0, 1, 0.001, 10, 20, 0.004, 30, 40]
    assert raw.recv(4096) == b"SPL2" + struct.pack("<IIQq18d", 2, 2, 1, 5_000_000, *values)
    raw.close()


@pytest.mark.process
def test_latest(server, client):
    assert client.latest() is None
    for n in range(10):
        publish(server, n, [float(n)])
    assert client.latest().sequence == 10
    assert client.latest().sequence == 10, "the newest one stays"
    publish(server, 99, [7.0])
    assert client.receive(1.0).time_ns == 99


@pytest.mark.process
def test_silence_is_an_error(client):
    with fails(HardwareError, "0.01 s", code="silent"):
        client.receive(0.01)


@pytest.mark.process
def test_server_that_goes(server, client):
    publish(server, 0, np.zeros(2))
    server.close()
    assert client.receive(1.0).sequence == 1, "what was sent is still read"
    with fails(HardwareError, code="gone"):
        client.receive(1.0)


@pytest.mark.process
def test_client_that_goes(server, client):
    client.close()
    for n in range(3):
        publish(server, n, np.zeros(3))
    assert server.connections == 0


@pytest.mark.process
def test_slow_client_loses_whole_frames_and_holds_nobody_up(server, client):
    for n in range(20_000):
        publish(server, n, np.full(12, float(n)))
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


@pytest.mark.process
def test_no_server(tmp_path):
    with fails(HardwareError, device=str(tmp_path / "nothing"), code="open"):
        PlantLinkClient(tmp_path / "nothing")


@pytest.mark.process
def test_socket_left_by_a_killed_server_is_replaced(tmp_path):
    left = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    left.bind(str(tmp_path / "plant"))
    left.close()
    Served(tmp_path / "plant").close()
    assert not (tmp_path / "plant").exists()


@pytest.mark.process
def test_file_in_the_way_is_kept(tmp_path):
    (tmp_path / "plant").write_text("mine")
    with fails(HardwareError, "in the way", device=str(tmp_path / "plant"), code="open"):
        Served(tmp_path / "plant")
    assert (tmp_path / "plant").read_text() == "mine"


@pytest.mark.process
def test_something_else_on_the_socket(tmp_path):
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(str(tmp_path / "plant"))
    listener.listen()
    client = PlantLinkClient(tmp_path / "plant")
    other, _ = listener.accept()
    other.send(b"HTTP/1.1 200 OK, and more than a header")
    with fails(HardwareError, device=str(tmp_path / "plant"), code="refused"):
        client.receive(1.0)
    for sock in (client, other, listener):
        sock.close()


@pytest.mark.process
def test_a_second_server_leaves_a_living_one_alone(server, tmp_path):
    with fails(HardwareError, "another emulator", device=str(server.path), code="open"):
        Served(server.path)
    client = connected(server)
    publish(server, 0, np.zeros(3))
    assert client.receive(1.0).sequence == 1
    client.close()


@pytest.mark.process
def test_one_that_ends_takes_only_its_own_file_away(server):
    server.path.unlink()
    other = Served(server.path)
    server.close()
    assert server.path.exists()
    other.close()
    assert not server.path.exists()


def test_a_missing_folder_is_named(tmp_path):
    with fails(
        HardwareError, f"no folder {tmp_path / 'no'}", device=str(tmp_path / "no" / "plant"), code="open"
    ):
        Served(tmp_path / "no" / "plant")


# A twin that moves the air ------------------------------------------------------------------------
@pytest.mark.process
def test_what_the_valves_do_comes_over(server, client):
    condition = ValveCondition(*np.arange(15.0).reshape(5, 3))
    action = ValveAction(((0.002, np.array([1.0, 2.0, 3.0])),), condition)
    publish(server, 0, [7.0, 8.0, 9.0], action)
    frame = client.receive(1.0)
    np.testing.assert_array_equal(frame.pressures, [7.0, 8.0, 9.0])
    ((span, target),) = frame.action.spans
    assert span == 0.002
    np.testing.assert_array_equal(target, [1.0, 2.0, 3.0])
    for name in ("fill", "vent", "supply_pa", "loss_1_s", "is_open"):
        np.testing.assert_array_equal(getattr(frame.action.condition, name), getattr(condition, name))


def client_frame(server, client):
    publish(server, 0, np.zeros(3))
    return client.receive(1.0)


def answer(server, client, pressures):
    client.answer(client_frame(server, client), np.asarray(pressures, dtype=float))
    server.turn()


@pytest.mark.process
@pytest.mark.parametrize("moves_air", [True, False])
def test_a_twin_begins_where_the_air_is(server, client, moves_air):
    for n in range(5000):  # messages that were not read are old, and the newest of it is lost
        publish(server, n, np.zeros(3))
    frame = server.join(client, moves_air)
    assert (frame.sequence, frame.time_ns) == (0, 4999)
    np.testing.assert_array_equal(frame.pressures, [7.0, 8.0, 9.0])
    if moves_air:
        np.testing.assert_array_equal(server.pressures(), [7.0, 8.0, 9.0])
    else:
        assert server.pressures() is None


@pytest.mark.process
def test_pressures_come_back_until_they_are_released(server, client):
    server.join(client)
    answer(server, client, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(server.pressures(), [1.0, 2.0, 3.0])
    answer(server, client, [4.0, 5.0, 6.0])
    answer(server, client, [7.0, 8.0, 9.5])
    np.testing.assert_array_equal(server.pressures(), [7.0, 8.0, 9.5])
    np.testing.assert_array_equal(server.pressures(), [7.0, 8.0, 9.5])
    client.answer(client_frame(server, client), np.array([1.0, 1.0, 2.0]))
    client.release()
    server.turn()
    np.testing.assert_array_equal(server.pressures(), [1.0, 1.0, 2.0], "an unread message is not lost")
    assert server.pressures() is None


@pytest.mark.process
def test_a_twin_that_dies_leaves_the_air(server, client):
    server.join(client)
    assert server.pressures() is not None
    client.close()
    server.turn()
    np.testing.assert_array_equal(server.pressures(), [7.0, 8.0, 9.0])
    assert server.pressures() is None


@pytest.mark.process
@pytest.mark.parametrize("pressures", [np.ones(2), [1.0, math.nan, 1.0], [1.0, math.inf, 0.0]])
def test_pressures_that_are_none_never_reach_the_devices(server, client, pressures):
    server.join(client)
    answer(server, client, pressures)
    assert server.pressures() is None, "the last frame has no answer"
    with fails(HardwareError, code="gone"):
        client.receive(1.0)


@pytest.mark.process
def test_only_one_moves_the_air(server, client):
    second = connected(server)
    server.join(client)
    with fails(HardwareError, code="refused"):
        server.join(second)
    answer(server, client, np.ones(3))
    np.testing.assert_array_equal(server.pressures(), np.ones(3))
    client.release()
    server.turn()
    server.join(second)
    assert server.pressures() is not None
    second.close()


@pytest.mark.process
def test_an_answer_without_a_claim_is_none(server, client):
    answer(server, client, np.ones(3))
    assert server.pressures() is None


@pytest.mark.process
def test_nonsense_from_a_client_costs_only_its_connection(server, client):
    raw = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    raw.connect(str(server.path))
    raw.sendall(b"GET / HTTP/1.1\r\nHost: soro\r\n\r\n")
    server.join(client)
    assert server.pressures() is not None
    assert server.connections == 1
    raw.close()


@pytest.mark.process
def test_in_lockstep_the_answer_to_the_last_frame_is_waited_for(in_lockstep):
    client = connected(in_lockstep)
    publish(in_lockstep, 0, np.zeros(3))  # from before it joined: no answer to this one is awaited
    in_lockstep.join(client)
    assert in_lockstep.pressures() is not None, "nothing was asked yet"
    publish(in_lockstep, 0, np.zeros(3))

    def twin():
        client.answer(client.receive(1.0), np.full(3, 5.0))

    thread = threading.Timer(0.02, twin)
    thread.start()
    np.testing.assert_array_equal(in_lockstep.pressures(), np.full(3, 5.0))
    thread.join()
    publish(in_lockstep, 1, np.zeros(3))
    with fails(HardwareError, "0.1 s", code="silent"):
        in_lockstep.pressures()
    client.close()
    assert in_lockstep.pressures() is None


@pytest.mark.process
def test_in_lockstep_nobody_waits_for_one_that_only_listens(in_lockstep):
    client = connected(in_lockstep)
    publish(in_lockstep, 0, np.zeros(3))
    assert in_lockstep.pressures() is None
    client.close()
