"""The emulated wire: arbitration by identifier, one frame at a time, each as long as its bits take.

A frame that is spoilt on its way is sent again, as controllers do, and counted by all of them; a controller
that is off the bus, or whose cable is off, neither hears nor is heard.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from soro_core.hardware.emulation.error_counters import ErrorCounters
from soro_core.hardware.emulation.faults import Faults
from soro_core.hardware.transport.frame import Frame, frame_bits

ERROR_FRAME_BITS = 23
QUEUE_LENGTH = 256  # frames that a port holds; further ones are lost, as in a full transmit buffer


class _Sending(NamedTuple):
    frame: Frame
    port: Port
    end_ns: int


class Port:
    """One participant: a queue of frames to send, and a function that takes what the others send.

    Attributes
    ----------
    errors : ErrorCounters
        Of its controller.
    report : callable
        Takes the counters and the letter of an error (as in slcan: a = no acknowledge, b = bit, c = CRC, or
        nothing) whenever the state has changed or an error was seen.
    """

    def __init__(self, receive: Callable[[Frame, int], None]) -> None:
        self.receive = receive
        self.queue: deque[tuple[int, Frame]] = deque()
        self.overruns = 0
        self.errors = ErrorCounters()
        self.report: Callable[[ErrorCounters, str], None] = lambda errors, letter: None
        self.plugged = True
        self._state = "active"

    @property
    def alive(self) -> bool:
        """Whether it takes part."""
        return self.plugged and not self.errors.is_off

    def noticed(self, letter: str = "") -> None:
        """Report an error or a change of state; off the bus, what was to be sent is lost."""
        state, self._state = self._state, self.errors.state
        if self.errors.is_off:
            self.queue.clear()
        if letter or state != self._state:
            self.report(self.errors, letter)

    def go_off(self) -> None:
        """Take the controller off the bus."""
        self.errors.transmit = 256
        self.noticed()

    def plug(self, plugged: bool) -> None:
        """Connect the cable or take it off: without it nobody acknowledges what is sent."""
        self.plugged = plugged
        if not plugged:
            self.errors.unacknowledged()
            self.noticed("a")

    def rejoin(self) -> None:
        """Reset the controller."""
        self.errors.reset()
        self.noticed()


class Hub:
    """A CAN bus.

    Parameters
    ----------
    bitrate : int
        Bit rate [bit/s] that paces the frames; 0 for frames that take no time (lockstep).

    Attributes
    ----------
    spoil : callable
        Asked at the end of every frame; a letter (b, c, f or s) means that it was spoilt on the wire.
    frames : int
        Frames carried so far.
    """

    def __init__(self, bitrate: int) -> None:
        self._bitrate = bitrate
        self._ports: list[Port] = []
        self._sending: _Sending | None = None
        self._idle_ns = 0
        self.frames = 0
        self._disturbed = False  # whether a controller has counted errors of reception
        self.spoil: Callable[[Frame, Port], str] = lambda frame, port: ""
        self._faults = Faults(supported=())
        self._struck: Port | None = None
        self._babbler = Port(lambda frame, now_ns: None)
        self._late: list[tuple[int, Frame, Port]] = []
        self._held: tuple[Frame, Port] | None = None

    def connect_faults(self, faults: Faults, host: Port) -> None:
        """Let faults act on the bus; some of them strike the controller of one port."""
        self._faults, self._struck = faults, host
        faults.on_start["bus_off"] = lambda _: host.go_off()
        faults.on_start["ack_missing"] = lambda _: host.plug(False)
        faults.on_end["ack_missing"] = lambda _: host.plug(True)
        faults.on_end["corrupt_bits"] = lambda _: self._calm(host)
        self.spoil = lambda frame, port: "c" if faults.happens("corrupt_bits") else ""

    def rejoin(self, port: Port) -> None:
        """Bring a controller back, unless what put it off is still there."""
        if port is self._struck and self._faults.value("bus_off") is not None:
            port.report(port.errors, "")
        else:
            port.rejoin()

    def _calm(self, host: Port) -> None:
        """Controllers of devices come back by themselves when the bus is quiet; the host's is reopened."""
        for port in self._ports:
            if port is not host:
                port.rejoin()

    def attach(self, receive: Callable[[Frame, int], None]) -> Port:
        """Add a participant; `receive(frame, time_ns)` is called at the end of every frame of another one."""
        port = Port(receive)
        self._ports.append(port)
        return port

    def send(self, port: Port, frame: Frame, now_ns: int) -> bool:
        """Queue a frame; False if the port has no place for it or is off the bus."""
        if not port.plugged:
            port.errors.unacknowledged()
            port.noticed("a")
        if port.errors.is_off or len(port.queue) >= QUEUE_LENGTH:
            port.overruns += 1
            return False
        port.queue.append((now_ns, frame))
        return True

    def run(self, now_ns: int) -> None:
        """Carry everything that ends by now."""
        while True:
            while self._late and self._late[0][0] <= now_ns:
                due_ns, frame, port = self._late.pop(0)
                self._deliver(frame, port, due_ns)
            if self._sending is None:
                self._arbitrate()
            sending = self._sending
            if sending is None or sending.end_ns > now_ns:
                return
            self._sending, self._idle_ns = None, sending.end_ns
            frame, port, end_ns = sending
            letter = "" if port is self._babbler else self.spoil(frame, port)
            self._count(port, letter)
            if letter:  # every controller sees it; the frame is destroyed and sent again
                if port.alive:
                    port.queue.appendleft((end_ns + self._duration_ns(ERROR_FRAME_BITS), frame))
                continue
            self.frames += 1
            if self._faults.is_active:
                self._mislead(frame, port, end_ns)
            else:
                self._deliver(frame, port, end_ns)

    @property
    def next_event_ns(self) -> int | None:
        """End of the frame on the wire, or time of a delayed one; None while there is neither."""
        times = [self._sending.end_ns] if self._sending else []
        times += [self._late[0][0]] if self._late else []
        return min(times, default=None)

    def _deliver(self, frame: Frame, sender: Port, end_ns: int) -> None:
        for port in self._ports:
            if port is not sender and port.alive:
                port.receive(frame, end_ns)

    def _mislead(self, frame: Frame, port: Port, end_ns: int) -> None:
        """Lose, double, hold back or delay a frame."""
        faults = self._faults
        if faults.happens("drop"):
            return
        passed = [(frame, port)] * (2 if faults.happens("duplicate") else 1)
        if self._held is not None:
            passed, self._held = [*passed, self._held], None
        elif faults.happens("reorder"):
            self._held = passed.pop()
        delay_ns = round((faults.value("delay") or 0.0) * 1e9)
        for late, sender in passed:
            if delay_ns:
                self._late.append((end_ns + delay_ns, late, sender))
            else:
                self._deliver(late, sender, end_ns)

    def _count(self, sender: Port, letter: str) -> None:
        sender.errors.sent(bool(letter))
        sender.noticed(letter)
        if not (letter or self._disturbed):
            return
        self._disturbed = False
        for port in self._ports:
            if port is not sender and port.alive:
                port.errors.received(bool(letter))
                port.noticed(letter)
                self._disturbed |= port.errors.receive > 0

    def _arbitrate(self) -> None:
        waiting = [port for port in self._ports if port.queue and port.alive]
        babbled = self._faults.value("babble") if self._faults.is_active else None
        if babbled is not None:
            waiting = self._shouted_down(waiting, int(babbled))
        if not waiting:
            return
        start = max(self._idle_ns, min(port.queue[0][0] for port in waiting))
        # Of those that are ready when the wire becomes free the lowest identifier wins; a standard frame wins
        # over an extended one with the same leading bits, a data frame over a remote one.
        port = min((p for p in waiting if p.queue[0][0] <= start), key=lambda p: _priority(p.queue[0][1]))
        _, frame = port.queue.popleft()
        self._sending = _Sending(frame, port, start + self._duration_ns(frame_bits(frame)))

    def _shouted_down(self, waiting: list[Port], babbled: int) -> list[Port]:
        """Who can send beside one who never stops."""
        if not self._bitrate:  # frames take no time: who loses the arbitration loses it for ever
            return [port for port in waiting if _priority(port.queue[0][1])[0] <= babbled]
        self._babbler.queue = deque([(self._idle_ns, Frame(babbled, bytes(8)))])
        return [*waiting, self._babbler]

    def _duration_ns(self, bits: int) -> int:
        return bits * 1_000_000_000 // self._bitrate if self._bitrate else 0


def _priority(frame: Frame) -> tuple[int, bool, int, bool]:
    leading = frame.can_id >> 18 if frame.extended else frame.can_id
    return leading, frame.extended, frame.can_id, frame.remote
