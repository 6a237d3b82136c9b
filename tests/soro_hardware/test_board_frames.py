"""Frames of `soro board`: exact bytes, damaged streams, and no bytes that end the decoder."""

import zlib

import numpy as np
import pytest

from soro_hardware.board import frames, messages
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.board.messages import Cause, PortFlag, PortState, Refusal, StateMessage, Welcome

N = 4
SET = BoardFrame(FrameType.SET, 7, messages.pack_set([0, 90_000, -1, 12_345]), 0x0102030405060708)


def decoder():
    return frames.BoardFrameDecoder(messages.lengths(N))


def test_bytes_of_a_set():
    header, payload = "73 42 02 02 10 00 07 00 00 00 0807060504030201", "00000000 905F0100 FFFFFFFF 39300000"
    body = bytes.fromhex(header + payload)
    assert frames.encode(SET) == body + zlib.crc32(body).to_bytes(4, "little")


PAYLOADS = {
    "HELLO": (FrameType.HELLO, messages.pack_hello(N), messages.unpack_hello, N),
    "SET": (FrameType.SET, SET.payload, messages.unpack_set, (0, 90_000, -1, 12_345)),
    "WELCOME": (
        FrameType.WELCOME,
        messages.pack_welcome(Welcome(0xDEADBEEF, 100, ((0, 90_000),) * N)),
        messages.unpack_welcome,
        Welcome(0xDEADBEEF, 100, ((0, 90_000),) * N),
    ),
    "STATE": (
        FrameType.STATE,
        messages.pack_state(
            StateMessage(5, True, Cause.WATCHDOG, 70_000, (PortState(-1, 2, PortFlag(9), 3),) * N)
        ),
        messages.unpack_state,
        StateMessage(5, True, Cause.WATCHDOG, 70_000 % 65_536, (PortState(-1, 2, PortFlag(9), 3),) * N),
    ),
    "REFUSED": (
        FrameType.REFUSED,
        messages.pack_refused(Refusal.RANGE, 3),
        messages.unpack_refused,
        (Refusal.RANGE, 3),
    ),
}


@pytest.mark.parametrize(("kind", "payload", "unpack", "value"), PAYLOADS.values(), ids=PAYLOADS.keys())
def test_payloads(kind, payload, unpack, value):
    assert unpack(payload) == value
    assert len(payload) == messages.lengths(N)[kind]
    assert decoder().feed(frames.encode(BoardFrame(kind, 3, payload))) == [BoardFrame(kind, 3, payload)]


def test_any_split_of_the_stream():
    stream = frames.encode(SET) * 3
    for step in range(1, len(stream)):
        taken = decoder()
        found = [f for at in range(0, len(stream), step) for f in taken.feed(stream[at : at + step])]
        assert found == [SET] * 3
        assert taken.garbled == 0


def test_every_flipped_bit_is_noticed_and_costs_one_frame():
    good = frames.encode(SET)
    for bit in range(8 * len(good)):
        bad = bytearray(good)
        bad[bit // 8] ^= 1 << bit % 8
        taken = decoder()
        assert taken.feed(bytes(bad) + good) == [SET], bit
        assert taken.garbled == 1


def test_a_greeting_of_version_1_is_told_apart_and_its_refusal_is_one_of_version_1():
    body = bytes.fromhex("73 42 01 01 02 00 00 00 00 00 04 00")
    taken = decoder()
    assert taken.feed(body + zlib.crc32(body).to_bytes(4, "little")) == []
    assert (taken.garbled, taken.other_version) == (1, 1)
    body = bytes.fromhex("73 42 01 83 04 00 00 00 00 00 09 00 00 00")
    refused = BoardFrame(FrameType.REFUSED, 0, messages.pack_refused(Refusal.VERSION))
    assert frames.encode(refused, 1) == body + zlib.crc32(body).to_bytes(4, "little")


def test_a_damaged_length_does_not_wait():
    bad = bytearray(frames.encode(SET))
    bad[4] = 0xFF
    taken = decoder()
    assert taken.feed(bytes(bad)) == []
    assert taken.feed(frames.encode(SET)) == [SET]


def test_fuzz():
    """20 000 pieces, good, damaged, cut and random: no good frame is lost, every bad piece is counted."""
    rng = np.random.default_rng(11)
    taken, made, good, bad, found = decoder(), [], set(), 0, []
    for number in range(20_000):
        kind = FrameType(int(rng.choice([int(k) for k in FrameType])))
        frame = BoardFrame(kind, number, rng.bytes(messages.lengths(N)[kind]))
        piece = bytearray(frames.encode(frame))
        made.append(frame)
        match int(rng.integers(4)):
            case 0:
                good.add(number)
            case 1:
                piece[int(rng.integers(len(piece)))] ^= int(rng.integers(1, 256))
            case 2:
                del piece[int(rng.integers(1, len(piece))) :]
            case 3:
                piece = bytearray(rng.bytes(int(rng.integers(1, 40))))
        bad += number not in good
        found += taken.feed(bytes(piece))
    found += taken.feed(frames.encode(SET))  # ends what is half there
    # What is found was made; a cut piece is whole again if a random one begins with its missing byte.
    assert found[:-1] == [made[frame.sequence] for frame in found[:-1]]
    assert found[-1] == SET
    extra = {frame.sequence for frame in found[:-1]} ^ good
    assert not extra & good
    assert len(extra) < 20
    # Bad pieces that touch may be one run of garbage.
    assert 0.5 * bad < taken.garbled <= 2 * bad


def test_an_unknown_cause_is_no_crash():
    payload = bytearray(PAYLOADS["STATE"][1])
    for cause in range(256):
        payload[9] = cause
        if cause in {int(c) for c in Cause}:
            assert messages.unpack_state(bytes(payload)).cause == cause
        else:
            with pytest.raises(ValueError, match="not a valid Cause"):
                messages.unpack_state(bytes(payload))
