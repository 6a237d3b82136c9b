"""Noise costs a driver's cycle about as much as so many bytes of traffic: it may come without end."""

import random
import time

import pytest

from soro_core.hardware.board import frames
from soro_core.hardware.serial_line.engine import LineSplitter
from soro_core.hardware.transport import slcan_codec, socketcand_codec
from soro_core.hardware.vtem import modbus

SIZE = 16384
STATE = frames.Frame(frames.Kind.STATE, 1, bytes(8))
CASES = {
    "slcan": (slcan_codec.Decoder, b"t18140F01D007\r"),
    "socketcand": (socketcand_codec.Decoder, b"< frame 181 12.345678 0F01D007 >"),
    "board": (lambda: frames.Decoder({frames.Kind.STATE: 8}), frames.encode(STATE)),
    "modbus": (modbus.Frames, b"\x00\x01\x00\x00\x00\x06\x01\x10\x00\x00\x00\x03"),
    "line": (lambda: LineSplitter(b"\r\n"), b"A +014.70 +015.00\r"),
}
NOISE = {"no end of a line": b"9" * SIZE, "zeros": bytes(SIZE), "random": random.Random(1).randbytes(SIZE)}


def cost_s(make, data):
    """Shortest of three, so that what else the machine does is not in it."""
    taken = []
    for _ in range(3):
        decoder, start = make(), time.perf_counter()
        decoder.feed(data)
        taken.append(time.perf_counter() - start)
        if taken[-1] > 1.0:
            break
    return min(taken)


@pytest.mark.parametrize("noise", NOISE)
@pytest.mark.parametrize("codec", CASES)
def test_noise_costs_about_as_much_as_traffic(codec, noise):
    make, message = CASES[codec]
    traffic = message * (SIZE // len(message))
    assert cost_s(make, NOISE[noise]) < 3.0 * cost_s(make, traffic)
