"""Who may connect to a board: the real server and the emulated one, over sockets, byte for byte the same."""

import contextlib
import socket
import time
import zlib

import numpy as np
import pytest
from board_bench import board_platform, greeted
from hardware_bench import merged
from served_bench import served
from test_board_server import PATIENT, cycles, serving

from soro_core.errors import HardwareError
from soro_hardware import open_regulator
from soro_hardware.board import frames, messages
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.board.messages import Refusal
from tests.refused import fails

pytestmark = pytest.mark.process

OTHERS = ["192.168.4.0/24", "10.0.0.7"]


class Board:
    """A board that tests connect to, whichever it is."""

    def __init__(self, platform, address):
        self.platform, self.address = platform, address

    def driver(self):
        """A driver that is not configured yet."""
        return open_regulator(self.platform, self.address)

    def connect(self):
        """A host without a driver."""
        host, port = self.address.split(":")
        return socket.create_connection((host, int(port)), timeout=10.0)

    def told(self):
        """What a host hears that only connects, until the board hangs up."""
        with self.connect() as host:
            return b"".join(iter(lambda: host.recv(4096), b""))


@pytest.fixture(params=["real", "emulated"])
def board_with(request, tmp_path):
    """Makes a board with some keys of the section `board` changed."""
    stack = []

    def make(**options):
        changes = merged(PATIENT, {"board": options})
        if request.param == "real":
            stack.append(serving(tmp_path, **changes))
            board = stack[-1].__enter__()
            return Board(board.platform, board.address)
        platform = board_platform(**changes)
        stack.append(served(platform))
        return Board(platform, stack[-1].__enter__()[1])

    yield make
    for context in stack:
        context.__exit__(None, None, None)


HELLO = frames.encode(BoardFrame(FrameType.HELLO, 0, messages.pack_hello(4)))
REFUSED_VERSION = BoardFrame(FrameType.REFUSED, 0, messages.pack_refused(Refusal.VERSION))


def refusal(why, sequence=0):
    return frames.encode(BoardFrame(FrameType.REFUSED, sequence, messages.pack_refused(why)))


def read_to_the_end(host):
    """What a host hears until the board hangs up, which it must do within 5 s."""
    host.settimeout(5.0)
    until_s, heard = time.monotonic() + 5.0, b""
    with contextlib.suppress(ConnectionResetError):
        while chunk := host.recv(4096):
            heard += chunk
            assert time.monotonic() < until_s
    return heard


def test_one_host_at_a_time(board_with):
    board = board_with()
    first, second = board.driver(), board.driver()
    first.configure()
    cycles(first, 5)
    assert board.told() == refusal(Refusal.BUSY)
    cycles(first, 5)
    with fails(HardwareError, "another host", device="board", code="refused"):
        second.configure()
    assert cycles(first, 5)[-1].faults == ()
    time.sleep(1.1)  # a host that has been silent for a second gives way
    second.configure()
    assert cycles(second, 5)[-1].faults == ()
    assert "link_lost" in {fault.code for fault in cycles(first, 2)[-1].faults}
    first.close()
    second.close()


def test_a_host_that_has_left_keeps_no_other_out(board_with):
    board = board_with()
    for _ in range(6):
        driver = board.driver()
        driver.configure()
        assert cycles(driver, 1)[-1].faults == ()
        driver.close()


def test_hosts_of_the_platform_file_alone_are_admitted(board_with):
    board = board_with(hosts=OTHERS)
    assert board.told() == refusal(Refusal.STRANGER)
    stranger = board.driver()
    with fails(HardwareError, "board.hosts", device="board", code="refused"):
        stranger.configure()
    stranger.close()


def test_a_network_that_holds_this_host_admits_it(board_with):
    driver = board_with(hosts=[*OTHERS, "127.0.0.0/8"]).driver()
    driver.configure()
    assert cycles(driver, 5)[-1].faults == ()
    driver.close()


def test_garbage_keeps_no_host_in_and_feeds_no_watchdog(board_with):
    """A program that sends anything but frames gives way after a second, however much it sends."""
    board = board_with(watchdog_s=0.2)
    rng = np.random.default_rng(7)
    with board.connect() as babbler:
        number = greeted(babbler)
        babbler.sendall(frames.encode(BoardFrame(FrameType.SET, 1, messages.pack_set([50_000] * 4), number)))
        decoder, states = frames.BoardFrameDecoder(messages.lengths(4)), []
        until_s = time.monotonic() + 1.5
        while time.monotonic() < until_s:
            babbler.sendall(rng.bytes(200))
            states += [f for f in decoder.feed(babbler.recv(65536)) if f.kind is FrameType.STATE]
            time.sleep(0.01)
        assert messages.unpack_state(states[-1].payload).cause is messages.Cause.WATCHDOG
        driver = board.driver()
        driver.configure()
        assert cycles(driver, 5)[-1].faults == ()
        driver.close()


BEGINNINGS = {
    "garbage": b"\r\n",
    "garbage before the greeting": b"s" + HELLO,
    "a greeting whose last bit is damaged": HELLO[:-1] + bytes([HELLO[-1] ^ 1]),
    "a set point": frames.encode(BoardFrame(FrameType.SET, 1, messages.pack_set([50_000] * 4))),
    "a reset": frames.encode(BoardFrame(FrameType.RESET, 1)),
}


@pytest.mark.parametrize("beginning", BEGINNINGS.values(), ids=BEGINNINGS.keys())
def test_a_connection_that_does_not_begin_with_a_greeting_is_closed(board_with, beginning):
    board = board_with()
    with board.connect() as host:
        host.sendall(beginning)
        assert read_to_the_end(host) in (b"", refusal(Refusal.NO_HELLO, 1))


@pytest.mark.parametrize("kind", [FrameType.SET, FrameType.RESET, FrameType.BYE])
def test_a_frame_without_the_number_of_the_welcome_ends_the_connection_and_vents(board_with, kind):
    board = board_with()
    with board.connect() as host:
        number = greeted(host)
        half = messages.pack_set([50_000] * 4)
        host.sendall(frames.encode(BoardFrame(FrameType.SET, 1, half, number)))
        payload = half if kind is FrameType.SET else b""
        host.sendall(frames.encode(BoardFrame(kind, 2, payload, number ^ 1)))
        assert read_to_the_end(host).endswith(refusal(Refusal.NUMBER, 2))
    other = board.driver()
    with board.connect() as host:
        assert greeted(host) != number, "drawn anew"
        decoder = frames.BoardFrameDecoder(messages.lengths(4))
        states = []
        while not states:  # the heartbeat
            states = decoder.feed(host.recv(4096))
        state = messages.unpack_state(states[0].payload)
        assert state.cause is messages.Cause.HOST_GONE
        assert not any(port.applied_pa > 100 for port in state.ports)
    other.configure()
    assert cycles(other, 5)[-1].faults == ()
    other.close()


def test_a_driver_of_version_1_is_told_so_in_its_own_frames(board_with):
    body = bytes.fromhex("73 42 01 01 02 00 00 00 00 00 04 00")
    with board_with().connect() as old:
        old.sendall(body + zlib.crc32(body).to_bytes(4, "little"))
        assert read_to_the_end(old) == frames.encode(REFUSED_VERSION, 1)


def test_a_board_of_version_1_is_named_by_the_driver():
    """It drops what it does not know, and answers nothing."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = "{}:{}".format(*silent.getsockname())
        driver = open_regulator(board_platform(host={"start_timeout_s": 0.2}), address)
        with fails(HardwareError, "another version than frames 2", device="board", code="silent"):
            driver.configure()
        driver.close()
