"""Who may connect to a board: the real server and the emulated one, over sockets, byte for byte the same."""

import socket
import time

import numpy as np
import pytest
from board_bench import board_platform
from hardware_bench import merged
from served_bench import served
from test_board_server import PATIENT, cycles, serving

from soro_core.errors import HardwareError
from soro_core.hardware import open_regulator
from soro_core.hardware.board import frames, messages
from soro_core.hardware.board.frames import BoardFrame, Kind
from soro_core.hardware.board.messages import Refusal
from tests.refused import fails

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


def refusal(why):
    return frames.encode(BoardFrame(Kind.REFUSED, 0, messages.pack_refused(why)))


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
    for _ in range(20):
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
        babbler.sendall(frames.encode(BoardFrame(Kind.HELLO, 0, messages.pack_hello(4))))
        babbler.sendall(frames.encode(BoardFrame(Kind.SET, 1, messages.pack_set([50_000] * 4))))
        decoder, states = frames.BoardFrameDecoder(messages.lengths(4)), []
        until_s = time.monotonic() + 1.5
        while time.monotonic() < until_s:
            babbler.sendall(rng.bytes(200))
            states += [f for f in decoder.feed(babbler.recv(65536)) if f.kind is Kind.STATE]
            time.sleep(0.01)
        assert messages.unpack_state(states[-1].payload).cause is messages.Cause.WATCHDOG
        driver = board.driver()
        driver.configure()
        assert cycles(driver, 5)[-1].faults == ()
        driver.close()
