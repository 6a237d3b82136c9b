"""SDO transfers of the driver: expedited writes, expedited or segmented reads.

The client of the canopen library is not used: its network needs a receive thread, which would own the bus
while the control loop polls it, and its exceptions do not name the failed step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, TypeVar

from soro_core.errors import HardwareError
from soro_hardware.canopen import sdo_frames
from soro_hardware.transport.frame import Frame

_Answer: TypeAlias = sdo_frames.SdoReply | sdo_frames.SdoSegment
_Parser: TypeAlias = Callable[[bytes], sdo_frames.SdoReply | None]
Reply = TypeVar("Reply", bound=_Answer)

_LONGEST = 4  # bytes of an object


class FrameCarrier(Protocol):
    """A bus that sends and receives frames."""

    def send(self, messages: Sequence[Frame]) -> None:
        """Send frames."""

    def receive(self, timeout_s: float) -> Frame | None:
        """Return the next frame, or None after `timeout_s` [s]."""


class SdoError(HardwareError):
    """A device gives no answer, or a wrong one; the bus works."""


class SdoAbortError(SdoError):
    """The device refused an access.

    Parameters
    ----------
    text : str
        What was refused.
    device, step : str
        Name of the device, and step of its start-up.
    abort : int
        Abort code (CiA 301).
    """

    def __init__(self, text: str, device: str, step: str, abort: int) -> None:
        self.abort = abort
        super().__init__(text, device, "refused", step)


class SdoClient:
    """SDO transfers with one node.

    Parameters
    ----------
    bus : FrameCarrier
        Bus of the node.
    node : int
        Node id.
    source : str
        Name of the device in errors.
    on_other : callable
        Called with each other frame during the wait for an answer.
    clock : callable
        Returns a monotonic time [s].
    timeout_s : float
        Longest wait for one answer [s].
    retries : int
        Number of further attempts after a timeout.
    """

    def __init__(
        self,
        bus: FrameCarrier,
        node: int,
        source: str,
        on_other: Callable[[Frame], None],
        clock: Callable[[], float],
        timeout_s: float,
        retries: int,
    ) -> None:
        self._bus, self._node, self._on_other, self._clock = bus, node, on_other, clock
        self._timeout_s, self._retries = timeout_s, retries
        self.source = source
        self.step = ""

    def read(self, index: int, sub: int = 0, is_signed: bool = False) -> int:
        """Read an object.

        Parameters
        ----------
        index, sub : int
        is_signed : bool
            Whether the value is signed.

        Raises
        ------
        SdoError
            If the device does not answer or refuses.
        """
        what = f"read {index:04X}:{sub}"
        reply = self._transfer(sdo_frames.sdo_read(self._node, index, sub), _reply_to(index, sub), what)
        data = self._segments(index, sub, what) if reply.in_segments else reply.data
        return int.from_bytes(data, "little", signed=is_signed)

    def write(self, index: int, sub: int, value: int, size: int) -> None:
        """Write an object; negative values in two's complement.

        Parameters
        ----------
        index, sub : int
        value : int
        size : int
            Size of the object [bytes].

        Raises
        ------
        SdoError
            If the device does not answer or refuses.
        """
        data = (value & (1 << 8 * size) - 1).to_bytes(size, "little")
        request = sdo_frames.sdo_write(self._node, index, sub, data)
        self._transfer(request, _reply_to(index, sub, is_write=True), f"write {index:04X}:{sub} = {value}")

    def write_checked(self, index: int, sub: int, value: int, size: int, is_signed: bool = False) -> None:
        """Write an object and read it back.

        Parameters
        ----------
        index, sub, value, size : int
            As in `SdoClient.write`.
        is_signed : bool
            Whether the value is signed.

        Raises
        ------
        SdoError
            If the device does not answer, refuses, or has another value.
        """
        self.write(index, sub, value, size)
        found = self.read(index, sub, is_signed)
        if found != value:
            raise self.error(f"wrote {index:04X}:{sub} = {value}, the device has {found}")

    def answers(self, index: int, timeout_s: float) -> bool:
        """Return whether the node gives any answer to a read within `timeout_s` [s]."""
        self._bus.send([sdo_frames.sdo_read(self._node, index, 0)])
        return self._await(_reply_to(index, 0), timeout_s) is not None

    def timer(self, timeout_s: float) -> Callable[[], bool]:
        """Return a function that returns whether `timeout_s` [s] have passed."""
        deadline = self._clock() + timeout_s
        return lambda: self._clock() >= deadline

    def error(self, text: str, code: str = "refused") -> SdoError:
        """Return an error that states the device and the step."""
        return SdoError(text, self.source, code, self.step)

    def _transfer(self, request: Frame, reply_to: _Parser, what: str) -> sdo_frames.SdoReply:
        for _ in range(self._retries + 1):
            self._bus.send([request])
            reply = self._await(reply_to, self._timeout_s)
            if reply is not None:
                self._require(reply, what)
                return reply
        raise self.error(f"SDO {what}: no answer in {self._retries + 1} x {self._timeout_s:g} s", "silent")

    def _segments(self, index: int, sub: int, what: str) -> bytes:
        """Return the data of a segmented read."""
        data, toggle, reply_to = b"", 0, _reply_to(index, sub)

        def parse(raw: bytes) -> _Answer | None:
            return sdo_frames.parse_sdo_segment(raw) or reply_to(raw)

        while len(data) <= _LONGEST:
            self._bus.send([sdo_frames.sdo_next_segment(self._node, toggle)])
            found = self._await(parse, self._timeout_s)
            if found is None:
                raise self.error(f"SDO {what}: a segment has not come in {self._timeout_s:g} s", "silent")
            if isinstance(found, sdo_frames.SdoReply):
                self._require(found, what)
            elif found.toggle == toggle:
                data, toggle = data + found.data, 1 - toggle
                if found.is_last:
                    return data
        raise self.error(f"SDO {what}: the device sends more than {_LONGEST} bytes")

    def _require(self, reply: sdo_frames.SdoReply, what: str) -> None:
        """Raise an error if the answer is an abort."""
        if reply.abort is not None:
            text = f"SDO {what} refused: {sdo_frames.abort_text(reply.abort)}"
            raise SdoAbortError(text, self.source, self.step, reply.abort)

    def _await(self, parse: Callable[[bytes], Reply | None], timeout_s: float) -> Reply | None:
        """Return the first answer that `parse` accepts; pass on other frames."""
        deadline = self._clock() + timeout_s
        while (left := deadline - self._clock()) > 0:
            frame = self._bus.receive(left)
            if frame is None:
                return None
            reply = None
            if frame.can_id == sdo_frames.SDO_RESPONSE + self._node:
                reply = parse(frame.data)
            if reply is not None:
                return reply
            self._on_other(frame)
        return None


def _reply_to(index: int, sub: int, is_write: bool = False) -> _Parser:
    """Return a parser of answers to one request.

    An answer for another object is a late one. So is the confirmation of a write before the answer to a read:
    a write that was repeated is confirmed twice.
    """

    def parse(data: bytes) -> sdo_frames.SdoReply | None:
        reply = sdo_frames.parse_sdo_reply(data)
        if reply is None or (reply.index, reply.sub) != (index, sub):
            return None
        return reply if reply.abort is not None or reply.confirms_write == is_write else None

    return parse
