"""socketcand: its codec, the driver over it, and servers that go or are none."""

import socket
import threading

import numpy as np
import pytest
from hardware_bench import PERIOD_NS, Bench, driver, emulator, platform, platform_file, transport
from hypothesis import given
from hypothesis import strategies as st

from soro_core.errors import HardwareError
from soro_hardware import open_regulator
from soro_hardware.doctor import examine
from soro_hardware.transport.frame import BUS_OFF, Frame
from soro_hardware.transport.link import CanLink
from soro_hardware.transport.open import open_bus
from soro_hardware.transport.slcan import SlcanBus
from soro_hardware.transport.socketcand import (
    SocketcandBus,
    SocketcandDecoder,
    WireError,
    Word,
    encode_error,
    encode_frame,
    encode_send,
)
from tests.patience import LIMIT_S
from tests.refused import fails

TARGET = np.array([20e3, 40e3, 60e3])
SOCKETCAND = {"transport": {"kind": "socketcand"}}
SHORT_S = 0.2


FRAMES = st.builds(
    lambda can_id, data, extended: Frame(can_id if extended else can_id & 0x7FF, data, extended),
    st.integers(0, 0x1FFFFFFF),
    st.binary(max_size=8),
    st.booleans(),
)


@given(FRAMES)
def test_socketcand_round_trip(frame):
    assert SocketcandDecoder().feed(encode_send(frame)) == [frame]
    assert SocketcandDecoder().feed(encode_frame(frame, 12_345_678_901)) == [frame]


@given(st.binary(max_size=400), st.lists(st.integers(1, 50), max_size=20))
def test_no_bytes_break_the_decoder(data, cuts):
    decoder = SocketcandDecoder()
    for cut in cuts:
        decoder.feed(data[:cut])
        data = data[cut:]
    decoder.feed(data)
    decoder.feed(b">" * 2)
    garbled = decoder.garbled
    assert decoder.feed(b"< frame 181 1.000000 0102 >")[-1:] == [Frame(0x181, b"\x01\x02")]
    assert decoder.garbled == garbled


def test_socketcand_lines():
    assert encode_send(Frame(0x201, b"\x07\x00\xd0\x07")) == b"< send 201 4 7 0 D0 7 >"
    assert encode_frame(Frame(0x181, b"\x0f\x01"), 1_500_000) == b"< frame 181 0.001500 0F01 >"
    decoder = SocketcandDecoder()
    assert decoder.feed(b"< hi >< o") == [Word("hi")]
    assert decoder.feed(b"k >" + encode_error(BUS_OFF, 0)) == [Word("ok"), WireError(BUS_OFF)]
    assert decoder.garbled == 0
    for bad in (b"< frame 8FF 1.0 00 >", b"< frame 181 1.0 0 >", b"noise< ok >", b"< \xff >", b"x" * 300):
        before = decoder.garbled
        decoder.feed(bad)
        assert decoder.garbled == before + 1, bad


@pytest.mark.process
def test_driver_over_socketcand_is_the_driver_over_slcan(tmp_path):
    bench = Bench(platform(), seed=4)
    bench.driver.configure()
    path = platform_file(tmp_path, **SOCKETCAND)
    with emulator(tmp_path, "--lockstep", "--seed", "4", platform=path) as served:
        address = served.ready.removeprefix("ready: ")
        assert address.startswith("127.0.0.1:")
        with driver(platform(**SOCKETCAND), address) as regulator:
            assert isinstance(regulator.link.bus, SocketcandBus)
            for cycle in range(100):
                ours = bench.exchange(*TARGET)
                theirs = regulator.exchange(TARGET, cycle * PERIOD_NS)
                np.testing.assert_array_equal(ours.pressure_pa, theirs.pressure_pa)
            assert regulator.statistics.frames_garbled == 0


@pytest.mark.process
def test_several_adapters_on_one_bus(tmp_path):
    """A second adapter hears what the first one's host and the devices say; the driver takes either."""
    path = platform_file(tmp_path, emulation={"adapters": ["slcan", "socketcand"]})
    with emulator(tmp_path, "--lockstep", platform=path) as served:
        pty, address = served.ready.removeprefix("ready: ").split(",")
        listener = open_bus(transport("slcan"), address)
        with driver(platform(), pty) as regulator:
            assert isinstance(regulator.link.bus, SlcanBus)
            assert regulator.exchange(TARGET, 0).faults == ()
            missing = {0x080, 0x181, 0x183, 0x201, 0x602, 0x77F}
            while missing and (frame := listener.recv_frame(LIMIT_S)):
                missing.discard(frame.can_id)
            assert not missing
        listener.shutdown()


@pytest.mark.process
def test_the_doctor_says_what_each_adapter_lets_its_host_see(tmp_path):
    path = platform_file(tmp_path, emulation={"adapters": ["slcan", "socketcand"]})
    with emulator(tmp_path, platform=path) as served:
        pty, address = served.ready.removeprefix("ready: ").split(",")
        slcan, socketcand = (
            {finding.name: finding for finding in examine(platform(), device, run_s=0.0)}
            for device in (pty, address)
        )
    assert slcan["acknowledgement"].level == "ok"
    assert "error frames" not in slcan
    assert socketcand["error frames"].level == "warn"
    assert "only if it was started with -e" in socketcand["error frames"].found
    assert "acknowledgement" not in socketcand
    assert "SYNC of node 1" not in slcan


@pytest.mark.process
def test_socketcand_server_that_goes_is_noticed_in_the_next_cycle(tmp_path):
    path = platform_file(tmp_path, **SOCKETCAND)
    regulator = open_regulator(platform(**SOCKETCAND), None, lockstep=True)
    with fails(HardwareError, "transport.host", device="socketcand", code="setting"):
        regulator.configure()
    with emulator(tmp_path, "--lockstep", platform=path) as served:
        address = served.ready.removeprefix("ready: ")
        regulator = open_regulator(platform(**SOCKETCAND), address, lockstep=True)
        regulator.configure()
        regulator.exchange(TARGET, 0)
        served.process.kill()
        served.process.wait(10)
        with fails(HardwareError, code="gone"):
            regulator.exchange(TARGET, PERIOD_NS)
        regulator.vent()
        with fails(HardwareError, code="open"):
            regulator.configure()
        regulator.close()


class Impostor:
    """A TCP server that says what it is told to."""

    def __init__(self, *answers):
        self._server = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._server.getsockname()[1]}"
        self._answers = answers
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self):
        host, _ = self._server.accept()
        for answer in self._answers:
            host.sendall(answer)
            if host.recv(100) == b"":
                break
        host.close()

    def close(self):
        self._thread.join()
        self._server.close()


@pytest.mark.process
@pytest.mark.parametrize(
    ("answers", "code", "names"),
    [
        ((b"< hi >", b"< error could not open bus >"), "refused", ("open can0", "error could not")),
        ((b"220 mail server ready\r\n",), "silent", ("greet",)),
        ((b"< hi >",), "gone", ()),
    ],
)
def test_what_is_no_socketcand_server(answers, code, names):
    impostor = Impostor(*answers)
    with fails(HardwareError, *names, code=code):
        open_bus(transport("socketcand", open_timeout_s=SHORT_S), impostor.address)
    impostor.close()


@pytest.mark.process
def test_remote_frames_are_not_for_socketcand(tmp_path):
    with emulator(tmp_path, platform=platform_file(tmp_path, **SOCKETCAND)) as served:
        bus = open_bus(transport("socketcand"), served.ready.removeprefix("ready: "))
        with fails(HardwareError, code="refused"):
            bus.send_frames([Frame(0x701, b"", remote=True, length=1)])
        bus.shutdown()


@pytest.fixture
def connected():
    """The link of a driver on a server, and the server's end of the connection after its greeting."""
    server = socket.create_server(("127.0.0.1", 0))
    ends = []

    def greet():
        end, _ = server.accept()
        ends.append(end)
        for word in (b"< hi >", b"< ok >"):
            end.sendall(word)
            end.recv(100)
        end.sendall(b"< ok >")

    thread = threading.Thread(target=greet)
    thread.start()
    address = f"127.0.0.1:{server.getsockname()[1]}"
    link = CanLink(lambda: open_bus(transport("socketcand", open_timeout_s=SHORT_S), address))
    link.open()
    thread.join()
    yield link, ends[0]
    link.close()
    ends[0].close()
    server.close()


@pytest.mark.process
def test_a_server_that_says_nothing_is_given_up():
    with socket.create_server(("127.0.0.1", 0)) as mute:
        address = f"127.0.0.1:{mute.getsockname()[1]}"
        with fails(HardwareError, "greet", code="silent"):
            open_bus(transport("socketcand", open_timeout_s=SHORT_S), address)


@pytest.mark.process
def test_a_server_that_hangs_up_between_two_cycles_is_gone_and_not_silent(connected):
    link, server = connected
    server.close()
    with fails(HardwareError, code="gone"):
        link.receive(LIMIT_S)


@pytest.mark.process
def test_a_bad_frame_neither_hides_the_others_nor_repeats_them(connected):
    """A frame that is read twice is an old pressure that looks new."""
    link, server = connected
    server.sendall(b"< frame 181 1.0 01 >< frame 18G 1.0 01 >< frame 182 1.0 02 >")
    assert link.receive(LIMIT_S) == Frame(0x181, b"\x01")
    assert link.receive(LIMIT_S) == Frame(0x182, b"\x02")
    server.sendall(b"< frame 183 1.0 03 >")
    assert link.receive(LIMIT_S) == Frame(0x183, b"\x03")
    assert link.receive(0.0) is None
    assert link.counts["garbled"] == 1


@pytest.mark.process
def test_a_server_that_takes_no_more_bytes_does_not_block_the_loop(connected):
    link, _ = connected
    frames = [Frame(0x201, bytes(8))] * 1000
    with fails(HardwareError, code="gone"):
        for _ in range(1000):  # 40 MB, which no buffer of a connection holds
            link.send(frames)
