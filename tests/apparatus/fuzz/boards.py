"""Boards over TCP: frames of `soro board` in both directions, the unframed stream of the published server."""

from __future__ import annotations

import random
import socket
import struct
import threading
import time
from functools import partial
from typing import Any

import numpy as np

from soro_core.errors import HardwareError
from soro_hardware import load_platform, open_regulator
from soro_hardware.board import frames, messages
from soro_hardware.board.config import BoardPlatform
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.board.pi.board import Board
from soro_hardware.board.pi.loop import Server
from soro_hardware.board.session import BoardSession
from soro_hardware.emulation.board.board import EmulatedBoard
from soro_hardware.emulation.veab import EmulatedVeabServer
from soro_hardware.platform import PlatformBase
from soro_hardware.veab import protocol
from tests.apparatus.faults.rigs import Rig, in_process
from tests.apparatus.fuzz.canopen import alive
from tests.apparatus.fuzz.pieces import Counted, Target, damaged

PORTS = 4


def board_platform() -> BoardPlatform:
    """The shipped platform with two of its six buses."""
    platform = load_platform("soro_board")
    assert isinstance(platform, BoardPlatform)
    return platform.model_copy(update={"ports": platform.ports[:PORTS]})


def frames_to_the_board(pieces: int, seed: int) -> Counted:
    """Every piece that is no frame is counted, a good frame behind it is taken, no port leaves its range."""
    rng, counted = random.Random(seed), Counted()
    devices = EmulatedBoard(board_platform(), lockstep=True)
    board = devices.board
    board.draw = lambda: 1
    hello = frames.encode(BoardFrame(FrameType.HELLO, 0, messages.pack_hello(PORTS)))
    for number in range(pieces):
        if not board.state.greeted:  # after a BYE, or garbage before a greeting
            board.host_came(devices.now_ns)
            board.feed(hello, devices.now_ns)
        before = board.garbled
        payload = [rng.randrange(-20_000, 120_000) if rng.random() < 0.2 else 40_000 for _ in range(PORTS)]
        sets = frames.encode(BoardFrame(FrameType.SET, number % 100, messages.pack_set(payload), 1))
        reset = frames.encode(BoardFrame(rng.choice((FrameType.RESET, FrameType.BYE)), 1, number=1))
        piece = damaged(rng, [sets] * 8 + [hello, reset])
        # What looks like the head of a frame is waited for; so some follow, and one at least is taken.
        # Garbage while the board waits for a greeting, as behind a BYE, ends the connection.
        answer = board.feed(piece, devices.now_ns)
        for _ in range(2):
            if board.hang_up:
                board.host_came(devices.now_ns)
            answer += board.feed(hello * 3, devices.now_ns)
        if not _welcomes(answer):
            raise AssertionError(f"a good frame was lost behind {piece.hex()}")
        _count(counted, piece, board.garbled - before)
        devices.now_ns += 4_000_000
        _check_ports(board)
    return counted


def frames_to_the_driver(pieces: int, seed: int) -> Counted:
    """The driver's side of the same."""
    rng, counted = random.Random(seed), Counted()
    link = _Scripted()
    session = BoardSession(link, PORTS)
    lengths = messages.lengths(PORTS)
    port = messages.PortState(0, 0, messages.PortFlag.NONE, 0)
    good = messages.pack_state(messages.StateMessage(1, True, messages.Cause.NONE, 0, (port,) * PORTS))
    last = frames.encode(BoardFrame(FrameType.STATE, 0xFFFF, good))
    for number in range(pieces):
        before = session.garbled
        kind = rng.choice((FrameType.WELCOME, FrameType.STATE, FrameType.REFUSED))
        payload = good if kind is FrameType.STATE and rng.random() < 0.7 else rng.randbytes(lengths[kind])
        link.coming = damaged(rng, [frames.encode(BoardFrame(kind, number, payload))])
        piece = link.coming
        session.receive(0.0)
        session.answered, link.coming = -1, last * 2
        session.receive(0.0)
        if session.answered != 0xFFFF:
            raise AssertionError(f"a good frame was lost behind {piece.hex()}")
        _count(counted, piece, session.garbled - before)
    return counted


def bytes_to_the_server(pieces: int, seed: int) -> Counted:
    """The server itself over TCP, host after host; one in order is served as ever when they have gone."""
    rng, counted = random.Random(seed), Counted()
    platform = board_platform()
    board = EmulatedBoard(platform, lockstep=True).board
    board.draw = lambda: 1
    listener = socket.create_server(("127.0.0.1", 0))
    server = Server(board, listener, time.monotonic_ns, lambda: None)
    serving = threading.Thread(target=server.run)
    serving.start()
    address = "{}:{}".format(*listener.getsockname())
    hello = frames.encode(BoardFrame(FrameType.HELLO, 0, messages.pack_hello(PORTS)))
    sets = [
        frames.encode(BoardFrame(FrameType.SET, n, messages.pack_set([40_000] * PORTS), 1)) for n in (1, 2, 3)
    ]
    try:
        while counted.sent < pieces:
            with socket.create_connection(listener.getsockname()) as host:
                for _ in range(min(200, pieces - counted.sent)):
                    try:
                        host.sendall(damaged(rng, [hello, *sets]))
                    except OSError:  # refused while the one before has not gone
                        break
                    counted.sent += 1
            _check_ports(board)
        if not serving.is_alive():
            raise AssertionError("the server's thread has ended")
        _serves(platform, address)
    finally:
        server.stop()
        serving.join(5.0)
        listener.close()
    counted.untold = counted.sent
    return counted


def stream_to_the_driver(pieces: int, seed: int) -> Counted:
    """Readings without frames: each piece gives possible readings, or breaks the stream, or is half a one."""
    rng, counted = random.Random(seed), Counted()
    ports, decoder = 12, protocol.ReadingDecoder(12)
    for _ in range(pieces):
        good = struct.pack(f"<{ports}d", *(rng.randrange(2048) * 0.005 for _ in range(ports)))
        piece = damaged(rng, [good], longest_noise=200)
        decoder.reset()
        found = decoder.feed(piece)
        if any(not -111e3 <= value <= 111e3 for reading in found for value in reading):
            raise AssertionError(f"{found} out of {piece.hex()}")
        counted.sent += 1
        if decoder.broken is not None:
            counted.bad += 1
        elif len(piece) % len(good) == 0:
            counted.good += bool(found)
            counted.untold += not found
        else:  # found by what comes behind it, unless whole values are missing
            decoder.feed(good)
            counted.bad += decoder.broken is not None
            counted.untold += decoder.broken is None
    return counted


def stream_to_the_server(pieces: int, seed: int) -> Counted:
    """The published server as emulated: it ends at what is no message; the valves stay in their range."""
    rng, counted = random.Random(seed), Counted()
    platform = load_platform("veab_tcp")
    devices = EmulatedVeabServer(platform, lockstep=True)
    for _ in range(pieces):
        if devices.ended is not None:
            devices.start()
            devices.connected(True)
        good = protocol.encode([rng.uniform(-100e3, 100e3) for _ in range(12)])
        devices.line.feed(damaged(rng, [good], longest_noise=200) or good)
        devices.line.output.clear()
        counted.sent += 1
        counted.bad += devices.ended is not None
        counted.good += devices.ended is None
        if np.abs(devices.pressure_pa).max() > 100e3:
            raise AssertionError(f"{devices.pressure_pa} in the chambers")
    return counted


def bytes_between(pieces: int, seed: int, name: str) -> Counted:
    """Damage on the way in both directions, under a driver at work that is reset when it has latched."""
    rng, counted = random.Random(seed), Counted()
    platform: PlatformBase = board_platform() if name == "soro_board" else load_platform(name)
    rig = in_process(platform)
    driver: Any = rig.regulator
    _begin(rig)
    period_ns, cycle = round(1e9 / platform.cycle_hz), 0
    while counted.sent < pieces:
        cycle += 1
        _disturb(rig, rng, counted)
        sent = driver.exchange(np.full(3, rng.uniform(0.0, 90e3)), cycle * period_ns)
        if not (sent.sent_pa.min() >= 0.0 and sent.sent_pa.max() <= 90e3):
            raise AssertionError(f"{sent.sent_pa} on the wire")
        if any(fault.latched for fault in sent.faults):
            _calm(rig)
            _begin(rig)
    _calm(rig)
    _begin(rig)
    alive(driver, cycle + 1, period_ns)
    rig.close()
    counted.untold = counted.sent
    return counted


class _Scripted:
    """A connection whose other end is the fuzzer."""

    is_open = True

    def __init__(self) -> None:
        self.coming = b""

    def receive(self, timeout_s: float) -> bytes:
        chunk, self.coming = self.coming, b""
        return chunk


def _begin(rig: Rig) -> None:
    """Reset; the published server ends when a connection that makes no sense is given up, and is started.

    A reset that finds the stream shifted says so and keeps the connection, for the server holds its pressures
    without one; the next reset gives it up, and the server ends.
    """
    for _ in range(3):
        if isinstance(rig.devices, EmulatedVeabServer) and rig.devices.ended is not None:
            rig.devices.start()
        try:
            return rig.regulator.configure()
        except HardwareError as error:
            refusal = error
    raise AssertionError(f"no reset after it: {refusal}")


def _disturb(rig: Rig, rng: random.Random, counted: Counted) -> None:
    def pass_on(chunk: bytes) -> bytes:
        if not chunk or rng.random() > 0.05:
            return chunk
        counted.sent += 1
        return damaged(rng, [chunk])

    for line in rig.devices.lines:
        line.to_host = line.to_devices = pass_on


def _calm(rig: Rig) -> None:
    for line in rig.devices.lines:
        line.to_host = line.to_devices = bytes


def _count(counted: Counted, piece: bytes, garbled: int) -> None:
    counted.sent += 1
    counted.bad += garbled > 0
    counted.good += garbled == 0 and bool(piece)
    counted.untold += not piece and not garbled


def _welcomes(answer: bytes) -> bool:
    found = frames.BoardFrameDecoder(messages.lengths(PORTS)).feed(answer)
    return any(frame.kind is FrameType.WELCOME for frame in found)


def _check_ports(board: Board) -> None:
    if not all(
        board.rules.minimum_pa <= value <= board.rules.maximum_pa for value in board.state.setpoint_pa
    ):
        raise AssertionError(f"ports at {board.state.setpoint_pa}")


def _serves(platform: PlatformBase, address: str) -> None:
    """A driver in order gets what it asks for, once the last stranger has been forgotten."""
    regulator = open_regulator(platform, address)
    regulator.configure()
    for _ in range(20):
        found = regulator.exchange(np.full(3, 20e3), time.monotonic_ns())
    regulator.close()
    if any(fault.latched for fault in found.faults):
        raise AssertionError(f"after it: {found.faults[0]}")


_BOARD: dict[str, tuple[Target, float]] = {
    "frames to the board": (frames_to_the_board, 0.4),
    "frames to the driver": (frames_to_the_driver, 0.5),
    "bytes to the server over TCP": (bytes_to_the_server, 0.09),
    "damage on the way, both directions": (partial(bytes_between, name="soro_board"), 0.01),
}
_VEAB: dict[str, tuple[Target, float]] = {
    "stream to the driver": (stream_to_the_driver, 0.7),
    "stream to the server": (stream_to_the_server, 0.29),
    "damage on the way, both directions": (partial(bytes_between, name="veab_tcp"), 0.01),
}


def targets(family: str) -> dict[str, tuple[Target, float]]:
    """Targets of one family."""
    return {"soro_board": _BOARD, "veab_tcp": _VEAB}[family]
