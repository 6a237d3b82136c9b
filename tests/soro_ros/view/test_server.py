"""The server of the view: real web sockets with the headers of good and bad browsers."""

import socket
import time
import urllib.request

import pytest

pytest.importorskip("viser", reason="the extra `view` is not installed")

import msgspec
import viser
import zstandard
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from soro_ros.view.access import Access
from soro_ros.view.server import ViewServer
from tests.soro_ros.view.browser import until

pytestmark = pytest.mark.process

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, 0.0, 1.0],
    "fov": 1.0,
    "near": 0.01,
    "far": 10.0,
    "image_height": 100,
    "image_width": 100,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 1.0, 0.0],
}


@pytest.fixture
def server():
    it = ViewServer(Access("the-token"), 18080)
    yield it
    it.stop()


def joined(server, cookie="", origin=""):
    """A web socket as the page of the view opens it."""
    port = server.get_port()
    return connect(
        f"ws://127.0.0.1:{port}/",
        origin=origin or f"http://127.0.0.1:{port}",
        subprotocols=[f"viser-v{viser.__version__}"],
        additional_headers={"Cookie": f"soro_view_{port}={cookie}"},
        proxy=None,
        max_size=None,
    )


def send(connection, message):
    connection.send(msgspec.msgpack.encode(message))


def press(connection, button):
    send(connection, {"type": "GuiUpdateMessage", "uuid": button._impl.uuid, "updates": {"value": True}})


@pytest.fixture
def pressed(server):
    found = []
    button = server.gui.add_button("vent")
    button.on_click(lambda event: found.append(event.client_id))
    return button, found


def test_a_press_with_the_token_counts_and_one_without_it_says_so(server, pressed):
    button, found = pressed
    with joined(server) as onlooker, joined(server, "the-token") as owner:
        for one in (onlooker, owner):
            send(one, CAMERA)
        until(lambda: len(server.get_clients()) == 2, "two clients")
        press(onlooker, button)
        send(onlooker, {"type": "GuiUpdateMessage", "uuid": button._impl.uuid, "updates": {"update_cb": []}})
        send(onlooker, {"type": "ShareUrlRequest"})
        refused = []
        while b"Refused" not in b"".join(refused):
            refused.append(unpacked(onlooker.recv(timeout=20.0)))
        assert found == []
        press(owner, button)
        until(lambda: found, "a press")
        assert len(found) == 1


def unpacked(data):
    """Text of a message of viser: two sizes, then compressed msgpack."""
    size = int.from_bytes(data[8:16], "little")
    return zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])


@pytest.mark.parametrize("origin", ["http://attacker.example", "http://127.0.0.1:3000", "null"])
def test_the_page_of_another_origin_gets_no_web_socket_even_with_the_cookie(server, origin):
    with pytest.raises(InvalidStatus) as refused, joined(server, "the-token", origin):
        pass
    assert refused.value.response.status_code == 403


def test_nobody_opens_a_way_from_outside(server, monkeypatch):
    made = []
    monkeypatch.setattr(viser._viser, "ViserTunnel", lambda *_: made.append(1))
    with joined(server, "the-token") as owner:
        send(owner, CAMERA)
        send(owner, {"type": "ShareUrlRequest"})
        until(server.get_clients, "a client")
        time.sleep(0.1)
    assert server.request_share_url() is None
    assert made == []
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", server.get_port()))  # another address of this host


def test_pages_cannot_be_framed_and_fetch_nothing_from_elsewhere(server):
    with urllib.request.urlopen(f"http://127.0.0.1:{server.get_port()}/") as answer:
        assert answer.headers["X-Frame-Options"] == "DENY"
        assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
        assert b"<html" in answer.read()


OWN = b"Host: 127.0.0.1:PORT\r\n"
SOCKET = OWN + b"Origin: http://127.0.0.1:PORT\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
KEY = b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
MALFORMED = {
    "two hosts": (b"/", OWN * 2),
    "two other hosts": (b"/", OWN + b"Host: attacker.example\r\n"),
    "no host": (b"/", b""),
    "an empty host": (b"/", b"Host:\r\n"),
    "a host with a port that is none": (b"/", b"Host: 127.0.0.1:http\r\n"),
    "a host with a port out of range": (b"/", b"Host: 127.0.0.1:99999\r\n"),
    "another address of this host": (b"/", b"Host: [::1]:PORT\r\n"),
    "half an address": (b"/", b"Host: [::1\r\n"),
    "a host that is no text": (b"/", b"Host: 127.0.0.1\xff:PORT\r\n"),
    "two origins": (b"/", SOCKET + b"Origin: http://attacker.example\r\n" + KEY),
    "the same origin twice": (b"/", SOCKET + b"Origin: http://127.0.0.1:PORT\r\n" + KEY),
    "an empty origin": (b"/", SOCKET.replace(b"http://127.0.0.1:PORT", b"") + KEY),
    "an origin that is no text": (b"/", SOCKET.replace(b"http", b"\xc3\xbc") + KEY),
    "two upgrades": (b"/", SOCKET + b"Upgrade: websocket\r\n" + KEY),
    "two cookies": (b"/", SOCKET + b"Cookie: soro_view_PORT=the-token\r\n" * 2 + KEY),
    "two encodings": (b"/", OWN + b"Accept-Encoding: gzip\r\n" * 2),
    "a whole address as path": (b"http://127.0.0.1:PORT/", OWN),
    "another's whole address as path": (b"http://attacker.example/", OWN),
    "half an address as path": (b"//[::1", OWN),
    "no path": (b"*", OWN),
    "a path that is no text": (b"/\xff", OWN),
    "a path with a NUL": (b"/%00", OWN),
    "a path longer than a file name": (b"/" + b"a" * 4000, OWN),
    "a token that is no text": (b"/?token=\xff", OWN),
    "a token of escaped bytes": (b"/?token=%ff%00", OWN),
    "two tokens": (b"/?token=a&token=b", OWN),
}


@pytest.mark.parametrize(("path", "headers"), MALFORMED.values(), ids=MALFORMED.keys())
def test_a_malformed_request_is_refused_in_one_line(server, path, headers):
    port = server.get_port()
    request = b"GET %s HTTP/1.1\r\n%s\r\n" % (path, headers)
    with socket.create_connection(("127.0.0.1", port), timeout=10.0) as browser:
        browser.sendall(request.replace(b"PORT", str(port).encode()))
        answer = b"".join(iter(lambda: browser.recv(65536), b""))
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.split()[1] in (b"400", b"403", b"404"), head
    assert body.count(b"\n") == 1
    assert b"Set-Cookie" not in head
    with joined(server, "the-token"):  # it serves on
        pass


def test_a_second_view_takes_the_next_port(server):
    other = ViewServer(Access(), server.get_port())
    try:
        assert other.get_port() > server.get_port()
    finally:
        other.stop()
