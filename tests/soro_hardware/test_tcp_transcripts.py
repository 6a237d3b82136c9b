"""Exact bytes of `soro board` and of the VEAB client: start-up, a cycle, a fault, recovery, chips."""

import pytest
from board_bench import BOARD, ONE_VALVE, QUIET, BoardBench, VeabBench, board_platform, lines, veab_platform
from hardware_bench import transcript

MS = 1_000_000


def recorded(name):
    """Lines of a transcript without the blanks that set the fields apart."""
    return [" ".join(line.split()) for line in transcript(name)]


@pytest.fixture
def board():
    return BoardBench(board_platform(valves=ONE_VALVE, ports=BOARD["ports"][:1], **QUIET))


def test_board_start_up_and_cycle(board):
    board.driver.configure()
    board.run(2, 20e3)
    assert lines(board.link.take_log()) == recorded("board_start_up")


def test_board_fault_and_recovery(board):
    board.driver.configure()
    board.run(2, 20e3)
    board.link.take_log()
    board.devices.tick(board.devices.now_ns + 101 * MS)
    board.run(2, 20e3)
    board.driver.configure()
    board.run(1, 20e3)
    assert lines(board.link.take_log()) == recorded("board_fault")


def test_board_vent_and_shutdown(board):
    board.driver.configure()
    board.link.take_log()
    board.driver.vent()
    board.driver.close()
    assert lines(board.link.take_log()) == recorded("board_shutdown")


def test_chips(board):
    log = board.devices.buses[1].log = []
    board.driver.configure()
    board.run(1, 20e3)
    assert log == recorded("board_i2c")


def test_veab():
    veab = VeabBench(veab_platform(valves=ONE_VALVE, ports=2, **QUIET))
    veab.driver.configure()
    veab.run(1, 20e3)
    veab.devices.line.put(b"\x40")
    veab.run(3, 20e3)
    veab.devices.start()
    assert veab.run(1, 20e3).faults[0].code == "out_of_sync"
    found = lines(veab.link.take_log())
    assert found[: len(recorded("veab"))] == recorded("veab")
