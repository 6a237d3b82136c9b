"""Noise may come without end: what a decoder does with it grows as its length does, not as its square."""

import random

import pytest

from soro_core.hardware.board import frames
from soro_core.hardware.serial_line.engine import LineSplitter
from soro_core.hardware.transport import slcan_codec, socketcand_codec
from soro_core.hardware.vtem import modbus

# Of the square of this every decoder that has had one took minutes: what goes on here is seen to end.
SIZE = 1 << 20
CODECS = {
    "slcan": slcan_codec.Decoder,
    "socketcand": socketcand_codec.Decoder,
    "board": lambda: frames.Decoder({frames.Kind.STATE: 8}),
    "modbus": modbus.Frames,
    "line": lambda: LineSplitter(b"\r\n"),
}
NOISE = {
    "no end of a line": lambda: b"9" * SIZE,
    "zeros": lambda: bytes(SIZE),
    "random": lambda: random.Random(1).randbytes(SIZE),
}


@pytest.mark.timeout(30)
@pytest.mark.parametrize("noise", NOISE)
@pytest.mark.parametrize("codec", CODECS)
def test_noise_comes_to_an_end(codec, noise):
    CODECS[codec]().feed(NOISE[noise]())
