"""Noise may come without end: what a decoder does with it grows as its length does, not as its square."""

import random
import time

import pytest

from soro_hardware.board import frames
from soro_hardware.serial_line.line.request import LineSplitter
from soro_hardware.transport import slcan_codec, socketcand
from soro_hardware.vtem import modbus

SIZES = [1 << power for power in (12, 14, 16, 18)]
# What takes less says nothing of its growth [s]; of the largest noise the square takes seconds at least.
NEGLIGIBLE_S = 0.2
CODECS = {
    "slcan": slcan_codec.SlcanDecoder,
    "socketcand": socketcand.SocketcandDecoder,
    "board": lambda: frames.BoardFrameDecoder({frames.FrameType.STATE: 8}),
    "modbus": modbus.ModbusDecoder,
    "line": lambda: LineSplitter(b"\r\n"),
}
NOISE = {
    "no end of a line": lambda size: b"9" * size,
    "zeros": bytes,
    "random": lambda size: random.Random(1).randbytes(size),
}


def cost_s(decoder, noise, piece):
    """Processor time of this thread, which other processes do not lengthen."""
    start = time.thread_time()
    for at in range(0, len(noise), piece):
        decoder.feed(noise[at : at + piece])
    return time.thread_time() - start


@pytest.mark.parametrize("piece", [64, max(SIZES)])
@pytest.mark.parametrize("noise", NOISE)
@pytest.mark.parametrize("codec", CODECS)
def test_four_times_the_noise_costs_not_sixteen_times_as_much(codec, noise, piece):
    before = 0.0
    for size in SIZES:
        cost = cost_s(CODECS[codec](), NOISE[noise](size), piece)
        assert cost < max(8.0 * before, NEGLIGIBLE_S), size
        before = cost
