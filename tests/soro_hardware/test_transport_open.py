"""Opening a CAN bus: by name, and errors in one line that say what to do."""

import errno

import can
import pytest
from hardware_bench import platform, transport

from soro_core.errors import HardwareError
from soro_hardware import open_regulator
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.link import CanLink
from soro_hardware.transport.open import open_bus
from tests.refused import fails

KERNEL = {
    errno.ENODEV: "network interface",
    errno.EAFNOSUPPORT: "can_raw",
    errno.ENETDOWN: "`sudo ip link set can0 up type can bitrate 500000`",
    errno.EPERM: "permission",
    errno.EIO: "Input/output error",
}


@pytest.mark.parametrize(("number", "text"), KERNEL.items(), ids=[errno.errorcode[n] for n in KERNEL])
def test_kernel_errors_say_what_to_do(number, text, monkeypatch):
    def refuse(**_):
        raise OSError(number, {errno.EIO: "Input/output error"}.get(number, "x"))

    monkeypatch.setattr(can, "Bus", refuse)
    with fails(HardwareError, text, device="socketcan can0", code="open"):
        open_bus(transport("socketcan", channel="can0", bitrate=500_000))


def test_missing_package_of_an_interface(monkeypatch):
    def refuse(**_):
        raise can.CanInterfaceNotImplementedError("no module named 'usb'")

    monkeypatch.setattr(can, "Bus", refuse)
    with fails(HardwareError, "package", device="gs_usb 0", code="open"):
        open_bus(transport("python_can", interface="gs_usb", channel=0))


def test_absent_interface_of_this_machine():
    """Whatever this kernel has: one line, no traceback of another kind."""
    regulator = open_regulator(platform(transport={"kind": "socketcan", "channel": "none9"}))
    with fails(HardwareError, device="socketcan none9", code="open"):
        regulator.configure()


def test_unknown_interface_names_the_known_ones():
    with fails(HardwareError, "canbus", "socketcan", code="setting"):
        open_bus(transport("python_can", interface="canbus", channel="0"))


def test_any_python_can_interface_by_name():
    virtual = transport(
        "python_can", interface="virtual", channel="soro-test", options={"receive_own_messages": False}
    )
    other = can.Bus(interface="virtual", channel="soro-test")
    link = CanLink(lambda: open_bus(virtual))
    link.open()
    link.send([Frame(0x181, b"\x01\x02")])
    assert other.recv(1.0).data == b"\x01\x02"
    other.send(can.Message(arbitration_id=0x201, data=b"\x03", is_extended_id=False))
    assert link.receive(1.0) == Frame(0x201, b"\x03")
    link.close()
    other.shutdown()
