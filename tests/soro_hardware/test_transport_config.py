"""How a CAN bus is named in a platform file."""

import pytest
from hardware_bench import platform

from soro_core.errors import ConfigError
from soro_hardware import load_platform
from tests.refused import fails


def test_shipped_socketcan_platform():
    shipped = load_platform("canopen_socketcan")
    assert (shipped.transport.kind, shipped.device) == ("socketcan", "can0")


BAD = {
    "unknown kind": ({"kind": "usb"}, ("transport.kind", "'usb'", "'slcan'", "'socketcan'")),
    "no kind": ({"kind": None}, ("transport.kind",)),
    "unknown key": (
        {"kind": "socketcan", "channel": "can0", "baud": 1},
        ("transport.baud", "'an unknown key'", "open_timeout_s"),
    ),
    "no interface": ({"kind": "python_can", "channel": "x"}, ("transport.interface", "'nothing'")),
    "port": ({"kind": "socketcand", "port": 0}, ("transport.port", "0")),
    "bit rate": ({"kind": "socketcan", "channel": "can0", "bitrate": 3}, ("transport.bitrate", "3")),
}


@pytest.mark.parametrize(("transport", "found"), BAD.values(), ids=BAD.keys())
def test_bad_transport(transport, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        platform(transport=transport)
