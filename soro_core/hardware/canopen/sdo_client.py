"""Expedited SDO transfers of the driver.

Not the canopen library's client: that one needs its network with a receive thread, which would own the bus
while the control loop polls it, and whose exceptions cannot tell the step that failed.
"""

from __future__ import annotations

from collections.abc import Callable

from soro_core.errors import HardwareError
from soro_core.hardware.canopen import frames
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.link import CanLink


class SdoError(HardwareError):
    """A device does not answer, or not as it should; the bus itself works."""


class SdoAbortError(SdoError):
    """The device refused an access; `code` is its abort code."""

    def __init__(self, message: str, code: int) -> None:
        self.code = code
        super().__init__(message)


class SdoClient:
    """SDO transfers with one node.

    Parameters
    ----------
    link : CanLink
        The bus.
    node : int
        Node id.
    source : str
        How errors name the device.
    on_other : callable
        Takes every other frame that comes while an answer is awaited.
    clock : callable
        Monotonic time [s].
    timeout_s, retries
        Time for one answer, and further attempts after a timeout.
    """

    def __init__(
        self,
        link: CanLink,
        node: int,
        source: str,
        on_other: Callable[[Frame], None],
        clock: Callable[[], float],
        timeout_s: float,
        retries: int,
    ) -> None:
        self._link, self._node, self._on_other, self._clock = link, node, on_other, clock
        self._timeout_s, self._retries = timeout_s, retries
        self.source = source
        self.step = ""

    def read(self, index: int, sub: int = 0, is_signed: bool = False) -> int:
        """Value of an object."""
        reply = self._transfer(frames.sdo_read(self._node, index, sub), index, sub, f"read {index:04X}:{sub}")
        return int.from_bytes(reply.data, "little", signed=is_signed)

    def write(self, index: int, sub: int, value: int, size: int) -> None:
        """Write an object of `size` bytes; negative values in two's complement."""
        data = (value & (1 << 8 * size) - 1).to_bytes(size, "little")
        request = frames.sdo_write(self._node, index, sub, data)
        self._transfer(request, index, sub, f"write {index:04X}:{sub} = {value}")

    def write_checked(self, index: int, sub: int, value: int, size: int, is_signed: bool = False) -> None:
        """Write an object and read it back."""
        self.write(index, sub, value, size)
        found = self.read(index, sub, is_signed)
        if found != value:
            raise self.error(f"wrote {index:04X}:{sub} = {value}, the device has {found}")

    def answers(self, index: int, timeout_s: float) -> bool:
        """Whether the node answers a read within `timeout_s` (any answer counts)."""
        self._link.send([frames.sdo_read(self._node, index, 0)])
        return self._await(index, 0, timeout_s) is not None

    def timer(self, timeout_s: float) -> Callable[[], bool]:
        """Return a function that tells whether the time is over."""
        deadline = self._clock() + timeout_s
        return lambda: self._clock() >= deadline

    def error(self, text: str) -> SdoError:
        """Error that names the device and the step."""
        return SdoError(f"{self.source}: {self.step}: {text}")

    def _transfer(self, request: Frame, index: int, sub: int, what: str) -> frames.SdoReply:
        for _ in range(self._retries + 1):
            self._link.send([request])
            reply = self._await(index, sub, self._timeout_s)
            if reply is None:
                continue
            if reply.abort is not None:
                text = f"{self.source}: {self.step}: SDO {what} refused: {frames.abort_text(reply.abort)}"
                raise SdoAbortError(text, reply.abort)
            return reply
        raise self.error(f"SDO {what}: no answer in {self._retries + 1} x {self._timeout_s:g} s")

    def _await(self, index: int, sub: int, timeout_s: float) -> frames.SdoReply | None:
        deadline = self._clock() + timeout_s
        while (left := deadline - self._clock()) > 0:
            frame = self._link.receive(left)
            if frame is None:
                return None
            reply = None
            if frame.can_id == frames.SDO_RESPONSE + self._node:
                reply = frames.parse_sdo_reply(frame.data)
            # An answer to another object is one that came after its timeout.
            if reply is not None and (reply.index, reply.sub) == (index, sub):
                return reply
            self._on_other(frame)
        return None
