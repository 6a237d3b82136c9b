"""Errors of the system in messages: said once, without numbers, and with what to do."""

import errno
import os
import socket
import struct
import time

import pytest

from soro_core.errors import HardwareError
from soro_hardware.emulation.sockets.control import ControlClient
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient
from soro_hardware.error_text import reason
from soro_hardware.serial_line.line.port import SerialPort
from soro_hardware.transport.slcan import SlcanBus
from soro_hardware.transport.socketcand import SocketcandBus
from soro_hardware.transport.tcp import TcpLink

NOT_THERE = "No such file or directory; plug it in or start what makes it, or correct the path"
NO_PORT = "Inappropriate ioctl for device; it is no serial port, so correct the path"
REFUSED = "Connection refused; start what serves it, or correct the address"


@pytest.mark.process
@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: SerialPort("/dev/none", 9600), f"/dev/none: cannot open the port ({NOT_THERE})"),
        (
            lambda: SlcanBus("/dev/none", 1_000_000),
            f"/dev/none: cannot open the port ({NOT_THERE})",
        ),
        (
            lambda: SerialPort("/dev/null", 9600),
            f"/dev/null: cannot open the port ({NO_PORT})",
        ),
        (
            lambda: TcpLink("127.0.0.1:1", 1.0, time.monotonic).open(),
            f"127.0.0.1:1: cannot connect ({REFUSED})",
        ),
        (
            lambda: TcpLink("nowhere", 1.0, time.monotonic).open(),
            "nowhere: no such address, expected host:port, with a port of 1 to 65535",
        ),
        (
            lambda: SocketcandBus("127.0.0.1", 1, "can0"),
            f"socketcand 127.0.0.1:1 can0: no socketcand server answers ({REFUSED})",
        ),
        (lambda: PlantLinkClient("/none"), f"/none: no emulator serves this plant link ({NOT_THERE})"),
        (lambda: ControlClient("/none"), f"/none: no emulator listens for faults ({NOT_THERE})"),
    ],
    ids=["serial", "slcan", "no port", "tcp", "no address", "socketcand", "plant", "faults"],
)
def test_what_cannot_be_opened(make, text):
    with pytest.raises(HardwareError) as caught:
        make()
    assert str(caught.value) == text


def test_a_port_that_another_program_has():
    master, slave = os.openpty()
    path = os.ttyname(slave)
    first = SerialPort(path, 9600)
    with pytest.raises(HardwareError) as caught:
        SerialPort(path, 9600)
    first.close()
    os.close(master)
    os.close(slave)
    assert str(caught.value) == f"{path}: cannot open the port (in use by another program; end that program)"


@pytest.mark.process
def test_a_connection_that_is_reset():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        link = TcpLink("{}:{}".format(*listener.getsockname()), 1.0, time.monotonic)
        link.open()
        peer, _ = listener.accept()
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        peer.close()
        with pytest.raises(HardwareError) as caught:
            link.receive(5.0)
    found = "Connection reset by peer; start the other side again"
    assert str(caught.value) == f"{link.address}: the connection is gone ({found})"


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (TimeoutError("timed out"), "Connection timed out; check its cable and supply, and the address"),
        (socket.gaierror(-2, "Name or service not known"), "Name or service not known"),
        (OSError(errno.ENOBUFS, "[Errno 105] twice"), "No buffer space available"),
        (OSError("what a library says"), "what a library says"),
    ],
)
def test_other_errors(error, text):
    assert reason(error) == text
