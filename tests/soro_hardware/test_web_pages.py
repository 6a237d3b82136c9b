"""What a web page can send to each server: the bytes of a blind POST move no air, and lose the connection."""

import contextlib
import socket
import struct
import time

import numpy as np
import pytest
from board_bench import board_platform, veab_platform
from hardware_bench import platform as canopen_platform
from hardware_bench import wait_for
from served_bench import served
from test_board_server import PATIENT, cycles, serving
from vtem_bench import vtem_platform

from soro_hardware.board import frames, messages
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.socketcand import encode_send
from soro_hardware.veab.protocol import SAFE
from soro_hardware.vtem.modbus import write_request

pytestmark = pytest.mark.process

# What Chromium sends for `fetch(address, {method: "POST", mode: "no-cors", body: new Uint8Array(...)})`.
HEAD = (
    "POST {path} HTTP/1.1\r\nHost: {address}\r\nConnection: keep-alive\r\nContent-Length: {size}\r\n"
    'sec-ch-ua-platform: "Linux"\r\nUser-Agent: Mozilla/5.0 (X11; Linux x86_64) AppleWebKit/537.36 '
    "(KHTML, like Gecko) Chrome/131.0.0.0 Safari/537.36\r\nsec-ch-ua-mobile: ?0\r\nAccept: */*\r\n"
    "Origin: https://example.org\r\nSec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: no-cors\r\n"
    "Sec-Fetch-Dest: empty\r\nReferer: https://example.org/\r\nAccept-Encoding: gzip, deflate, br, zstd\r\n"
    "Accept-Language: en-US,en;q=0.9\r\n\r\n"
)
UPGRADE = (
    "GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    "Origin: https://example.org\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)


def post(address: str, body: bytes, path: str = "/") -> bytes:
    """The bytes of a page's POST."""
    return HEAD.format(path=path, address=address, size=len(body)).encode() + body


def upgrade(address: str, body: bytes) -> bytes:
    """The bytes of a page's web socket, and what it would send behind them."""
    return UPGRADE.format(path="/", address=address).encode() + body


def connected(address: str) -> socket.socket:
    host, port = address.split(":")
    return socket.create_connection((host, int(port)), timeout=10.0)


def closes(page: socket.socket) -> bool:
    """Whether the server closes the connection within 5 s, whatever it says before."""
    until_s = time.monotonic() + 5.0
    page.settimeout(5.0)
    with contextlib.suppress(ConnectionResetError):
        while page.recv(65536):
            if time.monotonic() > until_s:
                return False
    return True


def send_blindly(address: str, request: bytes) -> None:
    """Send a page's bytes; the server has to close the connection, at once or while they come."""
    with connected(address) as page:
        with contextlib.suppress(ConnectionResetError, BrokenPipeError):
            page.sendall(request)
        assert closes(page)


# -- bodies that would move air, without what only the answers tell ---------------------------------


def board_body() -> bytes:
    """A greeting, a reset and 1 s of set points, as the driver sends them."""
    hello = frames.encode(BoardFrame(FrameType.HELLO, 0, messages.pack_hello(4)))
    reset = frames.encode(BoardFrame(FrameType.RESET, 1))
    half = messages.pack_set([50_000] * 4)
    return hello + reset + b"".join(frames.encode(BoardFrame(FrameType.SET, n, half)) for n in range(2, 250))


def veab_body() -> bytes:
    return struct.pack("<4d", 0.75, 0.75, 0.75, 0.75) * 50


def vtem_body() -> bytes:
    registers = vtem_platform().registers.outputs
    return write_request(registers, [0xC003, 50_000, 50_000], 1, 1) * 50


def socketcand_body() -> bytes:
    start = encode_send(Frame(0, b"\x01\x00"))
    return b"< open can0 >< rawmode >" + start + encode_send(Frame(0x201, bytes(4))) * 50


PAGES = {"post": post, "web socket": upgrade, "body alone behind a line end": lambda _, body: b"\r\n" + body}


@pytest.mark.parametrize("request_of", PAGES.values(), ids=PAGES.keys())
def test_soro_board(tmp_path, request_of):
    with serving(tmp_path, **PATIENT) as board:
        before = len(board.entries())
        send_blindly(board.address, request_of(board.address, board_body()))
        assert len(board.entries()) == before, "not even a self-test"
        regulator = board.connect()  # at once: the page keeps no driver out
        assert cycles(regulator, 5)[-1].faults == ()
        regulator.close()


EMULATED = {
    "soro_board": (lambda: board_platform(**PATIENT), board_body),
    "veab_tcp": (veab_platform, veab_body),
    "vtem_modbus": (vtem_platform, vtem_body),
    "socketcand": (lambda: canopen_platform(emulation={"adapters": ["socketcand"]}), socketcand_body),
}


@pytest.mark.parametrize("request_of", [post, upgrade], ids=["post", "web socket"])
@pytest.mark.parametrize(("make", "body"), EMULATED.values(), ids=EMULATED.keys())
def test_emulated_servers(make, body, request_of):
    """No byte of a page reaches the emulated devices, so their pressures stay where they are."""
    with served(make()) as (devices, address):
        taken = []
        for line in devices.lines:
            line.to_devices = lambda chunk: taken.append(chunk) or chunk
        before = devices.now_ns
        send_blindly(address, request_of(address, body()))
        wait_for(lambda: devices.now_ns > before + 100_000_000)
        assert np.abs(devices.pressure_pa).max() < 2e3
        assert taken == []


@pytest.mark.parametrize("size", [1, 3, 8])
def test_a_path_whose_letters_are_set_points(size):
    """Eight letters are a number from 0 to 1: the published server would take this head for set points."""
    start = "POST /1 HTTP/1.1\r\nHost: 127.0.0."
    assert all(0.0 <= value <= 1.0 for (value,) in struct.iter_unpack("<d", start[:32].encode()))
    with served(veab_platform()) as (devices, address), connected(address) as page:
        for at in range(0, 32, size):
            with contextlib.suppress(ConnectionResetError, BrokenPipeError):
                page.sendall(start[at : at + size].encode())
            time.sleep(0.002)
        assert closes(page)
        assert {dac.normalized_value for dac in devices.dacs} == {SAFE}
