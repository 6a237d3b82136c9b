"""The emulated bus: a queue of frames, each transmitted for the duration of its bits.

Frames are transmitted in the order in which they are queued, without arbitration (ADR 0020). A frame that is
spoilt, which means destroyed on the bus, is sent again, and all controllers count the error. A controller in
bus-off, or with an unplugged cable, neither sends nor receives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from soro_hardware.emulation.faults.line_faults import Disorder
from soro_hardware.emulation.faults.schedule import FaultSchedule
from soro_hardware.transport.frame import Frame, frame_bits

WARNING, PASSIVE, OFF = 96, 128, 256


@dataclass
class ErrorCounters:
    """Transmit and receive error counters of one controller."""

    transmit: int = 0
    receive: int = 0

    @property
    def state(self) -> str:
        """``active``, ``warning``, ``passive`` or ``bus_off``."""
        if self.transmit >= OFF:
            return "bus_off"
        worst = max(self.transmit, self.receive)
        return "passive" if worst >= PASSIVE else "warning" if worst >= WARNING else "active"

    @property
    def is_off(self) -> bool:
        """Whether the controller is in bus-off: it neither sends nor receives."""
        return self.transmit >= OFF

    def sent(self, spoilt: bool = False) -> None:
        """Count a frame of this controller; `spoilt` means that it was destroyed on the bus."""
        if not self.is_off:
            self.transmit = self.transmit + 8 if spoilt else max(self.transmit - 1, 0)

    def unacknowledged(self) -> None:
        """Count a frame without acknowledgement, which leads to error passive, never to bus-off."""
        if self.transmit < PASSIVE:
            self.transmit = min(self.transmit + 8, PASSIVE)

    def received(self, spoilt: bool = False) -> None:
        """Count a frame of another controller; `spoilt` as in `sent`."""
        if spoilt:
            self.receive = min(self.receive + 1, 255)
        elif self.receive > 0:
            self.receive = min(self.receive, PASSIVE) - 1

    def reset(self) -> None:
        """Reset the counters, as after bus-off."""
        self.transmit = self.receive = 0


ERROR_FRAME_BITS = 23
QUEUE_LENGTH = 256  # frames in the transmit buffer of a controller; further ones are lost


class _Queued(NamedTuple):
    frame: Frame
    controller: BusController
    time_ns: int  # start of the wait; after the start of the transmission, its end


class BusController:
    """One controller on the bus.

    Parameters
    ----------
    receive : callable
        Called at the end of each frame of another controller, with the frame and the time [ns].

    Attributes
    ----------
    overruns : int
        Number of frames lost because the transmit buffer was full or the controller was in bus-off.
    errors : ErrorCounters
        Error counters.
    report : callable
        Called after an error or a change of state with the error counters and the letter of the error (as in
        slcan: a = no acknowledge, b = bit, c = CRC; empty for none).
    plugged : bool
        Whether the cable is plugged in.
    """

    def __init__(self, receive: Callable[[Frame, int], None]) -> None:
        self.receive = receive
        self.overruns = 0
        self.errors = ErrorCounters()
        self.report: Callable[[ErrorCounters, str], None] = lambda errors, letter: None
        self.plugged = True
        self._state = "active"

    @property
    def alive(self) -> bool:
        """Whether the controller sends and receives."""
        return self.plugged and not self.errors.is_off

    def noticed(self, letter: str = "") -> None:
        """Report an error, given its letter, or a change of state."""
        state, self._state = self._state, self.errors.state
        if letter or state != self._state:
            self.report(self.errors, letter)

    def go_off(self) -> None:
        """Put the controller into bus-off."""
        self.errors.transmit = 256
        self.noticed()

    def plug(self, plugged: bool) -> None:
        """Plug or unplug the cable; without it no other controller acknowledges the frames."""
        self.plugged = plugged
        if not plugged:
            self.errors.unacknowledged()
            self.noticed("a")

    def rejoin(self) -> None:
        """Reset the controller, which ends bus-off."""
        self.errors.reset()
        self.noticed()


class Hub:
    """A CAN bus.

    Parameters
    ----------
    bitrate : int
        Bit rate [bit/s]; 0 for frames without duration (lockstep).

    Attributes
    ----------
    spoil : callable
        Called at the end of every frame with the frame and its controller; returns the letter of the error
        (b, c, f or s) if the frame is spoilt.
    frames : int
        Number of frames transmitted.
    """

    def __init__(self, bitrate: int) -> None:
        self._bitrate = bitrate
        self.controllers: list[BusController] = []
        self._waiting: list[_Queued] = []
        self._sending: _Queued | None = None
        self._idle_ns = 0
        self.frames = 0
        self._disturbed = False  # whether any receive error counter is above 0
        self.spoil: Callable[[Frame, BusController], str] = lambda frame, controller: ""
        self._faults = FaultSchedule(supported=())
        self._host: BusController | None = None
        self._babbler = BusController(lambda frame, now_ns: None)
        self._disorder = Disorder[tuple[Frame, BusController]](self._faults)

    def connect_faults(self, faults: FaultSchedule, host: BusController) -> None:
        """Apply faults to the bus; `bus_off` and `ack_missing` act on the host's controller."""
        self._faults, self._host, self._disorder = faults, host, Disorder(faults)
        faults.on_start["bus_off"] = lambda _: host.go_off()
        faults.on_start["ack_missing"] = lambda _: host.plug(False)
        faults.on_end["ack_missing"] = lambda _: host.plug(True)
        faults.on_end["corrupt_bits"] = lambda _: self._rejoin_devices(host)
        self.spoil = lambda frame, controller: "c" if faults.happens("corrupt_bits") else ""

    def rejoin(self, controller: BusController) -> None:
        """Reset a controller in bus-off, unless the fault `bus_off` is still active."""
        if controller is self._host and self._faults.value("bus_off") is not None:
            controller.report(controller.errors, "")
        else:
            controller.rejoin()

    def _rejoin_devices(self, host: BusController) -> None:
        """Reset the controllers of the devices, which leave bus-off without a command of the host."""
        for controller in self.controllers:
            if controller is not host:
                controller.rejoin()

    def attach(self, receive: Callable[[Frame, int], None]) -> BusController:
        """Add a controller; `receive` as in `BusController`."""
        controller = BusController(receive)
        self.controllers.append(controller)
        return controller

    def send(self, controller: BusController, frame: Frame, now_ns: int) -> bool:
        """Queue a frame.

        Parameters
        ----------
        controller : BusController
            Sender.
        frame : Frame
        now_ns : int
            Present time [ns].

        Returns
        -------
        bool
            False if the transmit buffer is full or the controller is in bus-off.
        """
        if not controller.plugged:
            controller.errors.unacknowledged()
            controller.noticed("a")
        held = sum(queued.controller is controller for queued in self._waiting)
        if controller.errors.is_off or held >= QUEUE_LENGTH:
            controller.overruns += 1
            return False
        self._waiting.append(_Queued(frame, controller, now_ns))
        return True

    def run(self, now_ns: int) -> None:
        """Transmit all frames that end at or before `now_ns` [ns]."""
        while True:
            if self._sending is None:
                self._send_next()
            sending = self._sending
            late = self._disorder.release(now_ns if sending is None else min(sending.time_ns, now_ns))
            for due_ns, (frame, controller) in late:
                self._deliver(frame, controller, due_ns)
            if late:  # devices may have answered: check again which frame is next
                continue
            if sending is None or sending.time_ns > now_ns:
                return
            self._sending, self._idle_ns = None, sending.time_ns
            frame, controller, end_ns = sending
            letter = "" if controller is self._babbler else self.spoil(frame, controller)
            self._count(controller, letter)
            if letter:  # every controller detects the error; the frame is sent again
                again_ns = end_ns + self._duration_ns(ERROR_FRAME_BITS)
                self._waiting.insert(0, _Queued(frame, controller, again_ns))
                continue
            self.frames += 1
            passed = [(frame, controller)]
            if self._faults.is_active:
                passed = self._disorder.take((frame, controller), end_ns)
            for frame, sender in passed:
                self._deliver(frame, sender, end_ns)

    @property
    def next_event_ns(self) -> int | None:
        """Time [ns] of the end of the present frame or of the next delayed one; None if there is neither."""
        times = (self._sending.time_ns if self._sending else None, self._disorder.due_ns)
        return min((time for time in times if time is not None), default=None)

    def _deliver(self, frame: Frame, sender: BusController, end_ns: int) -> None:
        for controller in self.controllers:
            if controller is not sender and controller.alive:
                controller.receive(frame, end_ns)

    def _count(self, sender: BusController, letter: str) -> None:
        sender.errors.sent(bool(letter))
        sender.noticed(letter)
        if not (letter or self._disturbed):
            return
        self._disturbed = False
        for controller in self.controllers:
            if controller is not sender and controller.alive:
                controller.errors.received(bool(letter))
                controller.noticed(letter)
                self._disturbed |= controller.errors.receive > 0

    def _send_next(self) -> None:
        self._waiting = [queued for queued in self._waiting if not queued.controller.errors.is_off]
        able = [queued for queued in self._waiting if queued.controller.plugged]
        if self._faults.is_active and (babbled := self._faults.value("babble")) is not None:
            # Only frames with a lower identifier win against the device that floods the bus.
            able = [queued for queued in able if _leading_bits(queued.frame) <= babbled]
            if self._bitrate:  # without durations the flood would have no end
                flood = _Queued(Frame(int(babbled), bytes(8)), self._babbler, self._idle_ns)
                able = [queued for queued in able if queued.time_ns <= self._idle_ns] or [flood]
        if able:
            first = able[0]
            self._waiting = [queued for queued in self._waiting if queued is not first]
            end_ns = max(self._idle_ns, first.time_ns) + self._duration_ns(frame_bits(first.frame))
            self._sending = first._replace(time_ns=end_ns)

    def _duration_ns(self, bits: int) -> int:
        return bits * 1_000_000_000 // self._bitrate if self._bitrate else 0


def _leading_bits(frame: Frame) -> int:
    return frame.can_id >> 18 if frame.extended else frame.can_id
