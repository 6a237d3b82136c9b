"""The nodes on one bus: sends frames, distributes received frames, sends the host's signs of life.

The host's signs of life are its heartbeat, and requests of node guarding (CiA 301: a remote frame, which the
node answers with its state and a toggle bit). In the cycles both are sent when they are due, the requests in
turn, so that the answers do not all arrive in one cycle. During start-up and end, without cycles, the bus as
a context manager sends them in every period. Otherwise a device would report a lost host, keep that error and
leave OPERATIONAL.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from soro_hardware.canopen import frames
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.frames import NmtCommand, NmtState
from soro_hardware.canopen.monitor import NodeMonitor
from soro_hardware.canopen.sdo_client import SdoClient
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.link import CanLink


class NodeBus:
    """Link and nodes.

    Parameters
    ----------
    platform : CanopenPlatform
        Times.
    nodes : sequence of NodeMonitor
        States of the nodes.
    link : CanLink
        Link to the bus.
    clock : callable
        Returns a monotonic time [s].
    lockstep : bool
        Whether only the cycles advance the time of the devices.

    Attributes
    ----------
    now_ns : int
        Time of the present cycle [ns].
    """

    def __init__(
        self,
        platform: CanopenPlatform,
        nodes: Sequence[NodeMonitor],
        link: CanLink,
        clock: Callable[[], float],
        lockstep: bool,
    ) -> None:
        self.nodes, self.link, self.clock, self.lockstep = tuple(nodes), link, clock, lockstep
        self.now_ns = 0
        self._times = times = platform.canopen
        self._tpdos = {pdo.cob_id(node.node): (node, pdo) for node in nodes for pdo in node.device.tpdos}
        self._states = {frames.HEARTBEAT_BASE + node.node: node for node in nodes}
        self._emergencies = {frames.EMCY_BASE + node.node: node for node in nodes}
        self._heartbeat = frames.heartbeat(times.master_node, NmtState.OPERATIONAL)
        self._heartbeat_ns: int | None = None
        self._period_ns = round(times.heartbeat_s * 1e9)
        asked = {n: node.node for n, node in enumerate(nodes) if node.device.is_guarded}
        self._shift_ns = {node: n * self._period_ns // len(nodes) for n, node in asked.items()}
        self._asked: dict[int, int] = {}
        self._next_s = math.inf  # time of the next signs of life outside the cycles

    # -- the host's signs of life ------------------------------------------------------------------

    def signs_of_life(self) -> list[Frame]:
        """Return the host's heartbeat and its requests to all guarded nodes."""
        return [self._heartbeat, *map(frames.guard, self._shift_ns)]

    def due_signs(self) -> tuple[list[Frame], bool]:
        """Return the signs of life due in the present cycle, and whether the heartbeat is among them."""
        is_due = self._heartbeat_ns is None or self.now_ns - self._heartbeat_ns >= self._period_ns
        signs = [self._heartbeat] if is_due else []
        if is_due:
            self._heartbeat_ns = self.now_ns
        for node, shift_ns in self._shift_ns.items():
            turn = (self.now_ns - shift_ns) // self._period_ns
            if self._asked.setdefault(node, turn) != turn:
                self._asked[node] = turn
                signs.append(frames.guard(node))
        return signs, is_due

    def restart(self) -> None:
        """Prepare a start-up: the first cycle after it sends a heartbeat."""
        self._heartbeat_ns = None

    def __enter__(self) -> NodeBus:
        self._next_s = self.clock() + self._beat_s
        return self

    def __exit__(self, *error: object) -> None:
        self._next_s = math.inf

    def beat(self) -> None:
        """Send the signs of life now."""
        self._next_s = self.clock() + self._beat_s
        self.link.send(self.signs_of_life())

    @property
    def _beat_s(self) -> float:
        return math.inf if self.lockstep else self._times.heartbeat_s

    def _beat_if_due(self) -> None:
        if self.clock() >= self._next_s:
            self.beat()

    # -- frames ------------------------------------------------------------------------------------

    def take(self, frame: Frame, in_cycle: bool = False) -> None:
        """Pass a frame to its node; `in_cycle` as in `NodeMonitor.on_tpdo`."""
        if frame.extended or frame.remote:
            return
        if answer := self._tpdos.get(frame.can_id):
            node, pdo = answer
            node.on_tpdo(pdo, frame.data, self.now_ns, in_cycle)
        elif found := self._states.get(frame.can_id):
            found.on_state(frame.data, self.now_ns)
        elif found := self._emergencies.get(frame.can_id):
            found.on_emergency(frame.data)

    def drain(self) -> None:
        """Process the received frames without waiting."""
        for frame in self.link.waiting():
            self.take(frame)

    def send(self, messages: Sequence[Frame]) -> None:
        """Send frames."""
        self._beat_if_due()
        self.link.send(messages)

    def command(self, command: NmtCommand, *nodes: NodeMonitor) -> None:
        """Send an NMT command to some nodes."""
        self.send([frames.nmt(command, node.node) for node in nodes])

    def receive(self, timeout_s: float) -> Frame | None:
        """Return the next frame, or None after `timeout_s` [s]."""
        deadline = self.clock() + timeout_s
        while True:
            self._beat_if_due()
            now = self.clock()
            if self._next_s >= deadline:
                return self.link.receive(max(deadline - now, 0.0))
            frame = self.link.receive(max(self._next_s - now, 0.0))
            if frame is not None:
                return frame

    def wait_for(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Process frames until `done` or `timeout_s` [s]; return `done`."""
        deadline = self.clock() + timeout_s
        while not done():
            left = deadline - self.clock()
            frame = self.receive(max(left, 0.0))
            if frame is not None:
                self.take(frame)
            elif self.lockstep or left <= 0:  # in lockstep no frame arrives while the host waits
                return False
        return True

    def client(self, node: NodeMonitor) -> SdoClient:
        """Return the SDO client of one node."""
        times = self._times
        return SdoClient(
            self, node.node, node.source, self.take, self.clock, times.sdo_timeout_s, times.sdo_retries
        )
