"""The link to a CAN bus: error frames of the kernel, and its full queue."""

import errno

import can

from soro_core.errors import HardwareError
from soro_hardware.transport.frame import BUS_OFF, CONTROLLER, NO_ACKNOWLEDGE, RESTARTED, Frame, letters
from soro_hardware.transport.link import CanLink
from tests.refused import fails


class ErrorBus(can.BusABC):
    """A bus that has error frames of the kernel to give."""

    def __init__(self, *messages):
        self.channel_info, self.messages, self._is_shutdown = "errors", list(messages), True

    def send(self, msg, timeout=None):
        """Take it."""

    def recv(self, timeout=None):
        return self.messages.pop(0) if self.messages else None


def error_frame(classes, data=bytes(8)):
    return can.Message(arbitration_id=classes, is_error_frame=True, is_extended_id=True, data=data)


def test_error_frames_of_the_kernel_are_counted_and_tell_of_bus_off():
    frame = can.Message(arbitration_id=0x181, data=b"\x01", is_extended_id=False)
    bus = ErrorBus(error_frame(NO_ACKNOWLEDGE), frame, error_frame(BUS_OFF))
    link = CanLink(lambda: bus)
    link.open()
    assert link.receive(0.0) == Frame(0x181, b"\x01")
    assert not link.is_bus_off
    assert link.receive(0.0) is None
    assert link.is_bus_off
    assert link.counts["errors"] == 2
    bus.messages.append(error_frame(RESTARTED))
    link.receive(0.0)
    assert not link.is_bus_off
    assert letters(CONTROLLER, b"\x00\x01") == "o"


def test_full_queue_of_the_kernel_is_waited_for_but_not_for_ever():
    class Full(ErrorBus):
        tries = 0

        def send(self, msg, timeout=None):
            self.tries += 1
            if self.tries <= self.full:
                raise can.CanOperationError("No buffer space available", error_code=errno.ENOBUFS)

    bus = Full()
    link = CanLink(lambda: bus)
    link.open()
    bus.full = 5
    link.send([Frame(0x201)])
    assert (bus.tries, link.sent) == (6, 1)
    bus.full = 10**6
    with fails(HardwareError, "No buffer space", code="gone"):
        link.send([Frame(0x201)])
