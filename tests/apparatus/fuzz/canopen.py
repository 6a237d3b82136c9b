"""CANopen: lines of the adapter and frames of the bus to the driver, lines of a host to adapter and nodes."""

from __future__ import annotations

import random

import numpy as np

from soro_hardware import load_platform
from soro_hardware.canopen import frames
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.monitor import NodeMonitor
from soro_hardware.emulation.canopen.adapter import SlcanServer
from soro_hardware.emulation.canopen.world import World
from soro_hardware.transport import slcan_codec, socketcand
from soro_hardware.transport.frame import Frame
from tests.apparatus.faults.rigs import canopen
from tests.apparatus.fuzz.pieces import Counted, Target, damaged

_TO_HOST = [
    Frame(0x181, b"\x0f\x00\x10\x27"),
    Frame(0x182, b"\x0f\x00\x00\x00"),
    Frame(0x283, b"\x00\x10\x27\x00\x00"),
    Frame(0x81, b"\x20\x31\x04\x00\x00\x00\x00\x00"),
    Frame(0x701, b"\x05"),
    Frame(0x703, b"\x00"),
    Frame(0x581, b"\x43\x18\x10\x01\x98\x01\x00\x00"),
    Frame(0x0182_0001, b"\x01\x02", extended=True),
]
_TO_NODES = [
    Frame(0x201, b"\x07\x00\x10\x27"),
    Frame(0x202, b"\x07\x00\x00\x00"),
    Frame(0x080),
    Frame(0x000, b"\x01\x00"),
    Frame(0x000, b"\x81\x02"),
    Frame(0x601, b"\x40\x18\x10\x01\x00\x00\x00\x00"),
    Frame(0x602, b"\x2b\x40\x60\x00\x07\x00\x00\x00"),
    Frame(0x603, b"\x23\x00\x14\x01\x03\x02\x00\x80"),
    Frame(0x77F, b"\x05"),
    Frame(0x701, b"", remote=True, length=1),
]
_FROM_ADAPTER = [*map(slcan_codec.encode, _TO_HOST), b"z\r", b"\r", b"sa000000\r", b"sb255255\r", b"e1a\r"]
_FROM_HOST = [*map(slcan_codec.encode, _TO_NODES), b"O\r", b"C\r", b"S8\r", b"F\r", b"V\r", b"N\r", b"L\r"]
_FROM_SERVER = [
    *(socketcand.encode_frame(frame, 1_500_000_000) for frame in _TO_HOST),
    b"< hi >",
    b"< ok >",
    b"< error 20000040 1.000000 >",
]


def lines_to_the_driver(pieces: int, seed: int) -> Counted:
    """Every line of an adapter is one event or one count."""
    return _decoded(pieces, seed, slcan_codec.SlcanDecoder(), _FROM_ADAPTER, (b"", b"\r"), b"\r\x07")


def words_to_the_driver(pieces: int, seed: int) -> Counted:
    """Every pair of brackets of a socketcand server is one message or one count."""
    return _decoded(pieces, seed, socketcand.SocketcandDecoder(), _FROM_SERVER, (b"<", b">"), b"<>")


def frames_to_the_driver(pieces: int, seed: int) -> Counted:
    """Frames between those of the devices; malformed is one of a known identifier with a wrong length."""
    rng, counted = random.Random(seed), Counted()
    rig = canopen("emulated_canopen", real=False)
    driver, bus = rig.regulator, rig.regulator.link.open_bus()
    driver.configure()
    before, cycle, lengths = driver.statistics.frames_garbled, 0, _shortest(driver.nodes)
    while counted.sent < pieces:
        for _ in range(min(20, pieces - counted.sent)):
            frame = _frame(rng)
            bus.frames.append(frame)
            counted.sent += 1
            known = not (frame.extended or frame.remote) and frame.can_id in lengths
            counted.good += not known or len(frame.data) in lengths[frame.can_id]
        cycle += 1
        sent = driver.exchange(np.full(3, 40e3), cycle * 5_000_000).sent_pa
        if not (sent.min() >= 0.0 and sent.max() <= 90e3):
            raise AssertionError(f"{sent} on the wire")
    driver.exchange(np.zeros(3), (cycle + 1) * 5_000_000)
    counted.bad = driver.statistics.frames_garbled - before
    driver.configure()
    alive(driver, cycle + 2)
    rig.close()
    return counted


def lines_to_the_nodes(pieces: int, seed: int) -> Counted:
    """Every line of a host is answered once, by done or by BEL, whatever the nodes make of its frames."""
    rng, decoder, counted = random.Random(seed), slcan_codec.SlcanDecoder(), Counted()
    platform = load_platform("emulated_canopen")
    assert isinstance(platform, CanopenPlatform)
    world = World(platform, lambda frame: None, lockstep=True)
    adapter = world.add_adapter(SlcanServer)
    for number in range(pieces):
        line = damaged(rng, _FROM_HOST).replace(b"\r", b"") or b"V"
        if number % 50 == 0:
            line = b"O"
        adapter.feed(line + b"\r")
        counted.sent += 1
        for event in decoder.feed(bytes(adapter.output)):
            if isinstance(event, slcan_codec.Reply):
                counted.good += event.ok
                counted.bad += not event.ok
        adapter.output.clear()
        if not (world.pressure_pa.min() >= 0.0 and world.pressure_pa.max() <= 90e3):
            raise AssertionError(f"{world.pressure_pa} in the chambers")
    if decoder.garbled:
        raise AssertionError(f"{decoder.garbled} malformed lines of the adapter")
    return counted


def alive(driver: object, cycle: int, period_ns: int = 5_000_000) -> None:
    """The driver works as on the first day."""
    for number in range(100):
        found = driver.exchange(np.full(3, 40e3), (cycle + number) * period_ns)
        if found.faults:
            raise AssertionError(f"after it: {found.faults[0]}")
    if not np.allclose(found.pressure_pa, 40e3, atol=4e3):
        raise AssertionError(f"after it: {found.pressure_pa}")


def _decoded(
    pieces: int,
    seed: int,
    decoder: slcan_codec.SlcanDecoder | socketcand.SocketcandDecoder,
    messages: list[bytes],
    around: tuple[bytes, bytes],
    ends: bytes,
) -> Counted:
    """Pieces without the bytes that end one, each between those that make it one."""
    rng, counted = random.Random(seed), Counted()
    for _ in range(pieces):
        piece = damaged(rng, messages).translate(None, ends)
        before = decoder.garbled
        counted.sent += 1
        counted.good += len(decoder.feed(piece.join(around)))
        counted.bad += decoder.garbled - before
    return counted


def _frame(rng: random.Random) -> Frame:
    base = rng.choice(_TO_HOST)
    chance = rng.random()
    can_id = base.can_id if chance < 0.6 else rng.randrange(0x800)
    data = base.data if chance < 0.3 else rng.randbytes(rng.randrange(9))
    if rng.random() < 0.05:
        return Frame(rng.randrange(1 << 29), data, extended=True)
    return Frame(can_id & 0x7FF, data, remote=rng.random() < 0.02)


def _shortest(nodes: list[NodeMonitor]) -> dict[int, range]:
    """Lengths that are right, by the identifiers that the driver listens to."""
    lengths = {}
    for node in nodes:
        for pdo in node.device.tpdos:
            lengths[pdo.cob_id(node.node)] = range(pdo.layout.length, 9)
        lengths[frames.HEARTBEAT_BASE + node.node] = range(1, 2)
        lengths[frames.EMCY_BASE + node.node] = range(8, 9)
    return lengths


TARGETS: dict[str, tuple[Target, float]] = {
    "slcan lines to the driver": (lines_to_the_driver, 0.25),
    "socketcand words to the driver": (words_to_the_driver, 0.25),
    "frames to the driver": (frames_to_the_driver, 0.25),
    "slcan lines to adapter and nodes": (lines_to_the_nodes, 0.25),
}
