"""Driver for pressure valves on CANopen (CiA 301, CiA 408): one node a chamber, synchronous PDOs.

A cycle is: one RPDO a node (control word, set point), SYNC, one TPDO a node (status word, pressure sampled at
that SYNC). What keeps the arm safe when this process ends in any way are the devices' own watchdogs, which
the start-up arms: heartbeat consumer and RPDO deadline. Both begin to count with the first frame that they
watch, so that a configured arm may wait any time for its first exchange, holding 0 Pa.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import can
import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.canopen import frames, shutdown, startup
from soro_core.hardware.canopen.cia408 import Control
from soro_core.hardware.canopen.frames import NmtCommand, NmtState
from soro_core.hardware.canopen.monitor import NodeMonitor
from soro_core.hardware.canopen.sdo_client import SdoClient
from soro_core.hardware.platform import Platform
from soro_core.hardware.port import Array, BusStatistics, Exchange, Fault, Regulator
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.link import CanLink


class CanopenRegulator(Regulator):
    """Regulators of one arm on CANopen.

    Parameters
    ----------
    platform : Platform
        Valves, range and times.
    open_bus : callable
        Opens the bus; called by `configure`.
    clock : callable
        Monotonic time [s] for the limits of blocking steps.
    lockstep : bool
        Wait for every answer, pace nothing.
    """

    def __init__(
        self,
        platform: Platform,
        open_bus: Callable[[], can.BusABC],
        clock: Callable[[], float],
        lockstep: bool = False,
    ) -> None:
        self.platform = platform
        self.lockstep = lockstep
        self.clock = clock
        self._link = CanLink(open_bus)
        self._nodes = [NodeMonitor(valve.chamber, valve.node) for valve in platform.valves]
        self._by_tpdo = {frames.TPDO_BASES[0] + node.node: node for node in self._nodes}
        self._by_heartbeat = {frames.HEARTBEAT_BASE + node.node: node for node in self._nodes}
        self._by_emcy = {frames.EMCY_BASE + node.node: node for node in self._nodes}
        self._names = platform.chamber_names
        self._zeros = np.zeros(len(self._nodes))
        self._configured = self._closed = False
        self._heartbeat_ns: int | None = None
        self._zero_rounds = 0  # rounds of zeros since the last set point
        self._bus_off: Fault | None = None
        self._cycles = self._lost = 0
        self.now_ns = 0
        self.sent_pa: Array = self._zeros.copy()

    @property
    def chamber_names(self) -> tuple[str, ...]:
        return self._names

    @property
    def statistics(self) -> BusStatistics:
        nodes, counts = self._nodes, self._link.counts
        return BusStatistics(
            cycles=self._cycles,
            frames_sent=self._link.sent,
            frames_received=self._link.received,
            frames_lost=self._lost,
            frames_late=sum(node.late for node in nodes),
            frames_garbled=counts["garbled"] + sum(node.garbled for node in nodes),
            frames_refused=counts["refused"],
            emergencies=sum(node.emergencies for node in nodes),
            bus_errors=counts["errors"],
        )

    @property
    def latched(self) -> tuple[Fault, ...]:
        """Faults that only `configure` clears."""
        bus = () if self._bus_off is None else (self._bus_off,)
        return bus + tuple(fault for node in self._nodes for fault in node.latched.values())

    def configure(self) -> None:
        if self._closed:
            raise HardwareError("the driver is closed; make a new one")
        self._configured, self._heartbeat_ns = False, None
        self._bus_off = None
        self._link.open()
        for node in self._nodes:
            node.restart()
        clients = [self.client(number) for number in range(self.n_chambers)]
        times = self.platform.canopen
        link = self._link
        # A node that runs on from a former session stops exchanging values, and vents.
        link.send([frames.nmt(NmtCommand.PRE_OPERATIONAL, node.node) for node in self._nodes])
        for client in clients:
            startup.wait_for_boot(client, times.boot_timeout_s)
        for node, client in zip(self._nodes, clients, strict=True):
            node.configured = True  # from here on a boot-up is a fault
            node.scaling = startup.configure_node(client, node.node, self.platform)
        link.send([frames.nmt(NmtCommand.START, node.node) for node in self._nodes])
        for client in clients:
            startup.to_hold(client, times.activation_timeout_s)
        for node in self._nodes:
            node.latched.pop("left_operational", None)  # heartbeats of before NMT start
        if self.latched:
            raise HardwareError("; ".join(f"{f.source}: start-up: {f.message}" for f in self.latched))
        self.sent_pa, self._zero_rounds = self._zeros.copy(), 0
        self._configured = True

    def exchange(self, setpoint_pa: Array, now_ns: int) -> Exchange:
        if not self._configured:
            raise HardwareError("exchange before configure")
        setpoint = np.asarray(setpoint_pa, dtype=np.float64)
        if setpoint.shape != self._zeros.shape:
            raise HardwareError(f"{setpoint.shape} set points for {self.n_chambers} chambers")
        self.now_ns = now_ns
        self._drain()
        refused = self._refuse(setpoint)
        faults = self._cycle(None if refused or self.latched else setpoint)
        return Exchange(
            sent_pa=self.sent_pa.copy(),
            pressure_pa=np.array([node.pressure_pa for node in self._nodes]),
            fresh=np.array([node.fresh for node in self._nodes]),
            faults=(*refused, *faults),
        )

    def vent(self) -> None:
        if not self._link.is_open or self._bus_off is not None:
            return
        # In lockstep a round is a tick of the devices' clock, so there is one a call and the caller repeats.
        for _ in range(1 if self.lockstep else 2):
            # The devices' own watchdogs vent when the bus is gone.
            with contextlib.suppress(HardwareError):
                self._drain()
            with contextlib.suppress(HardwareError):
                self._link.send([self.own_heartbeat(), *self._zero_frames(), frames.SYNC])

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        if self._configured and self._bus_off is None:
            try:
                shutdown.bring_down(self)
            except HardwareError:
                self.vent()
        self._configured = False
        self._link.close()

    # -- for start-up and shutdown -----------------------------------------------------------------

    def command(self, setpoint_pa: Array, control: Control) -> Array:
        """One cycle with a control word for every node; pressures, NaN where none came."""
        self._drain()
        counts = self._counts(setpoint_pa)
        self._transact([self._rpdo(n, control, c) for n, c in zip(self._nodes, counts, strict=True)])
        return np.array([node.pressure_pa if node.fresh else np.nan for node in self._nodes])

    def client(self, number: int) -> SdoClient:
        """SDO client of one node."""
        node, times = self._nodes[number], self.platform.canopen
        return SdoClient(
            self._link,
            node.node,
            node.source,
            on_other=lambda frame: self._on_frame(frame, in_cycle=False),
            clock=self.clock,
            timeout_s=times.sdo_timeout_s,
            retries=times.sdo_retries,
        )

    def own_heartbeat(self) -> Frame:
        """Heartbeat of the host."""
        return frames.heartbeat(self.platform.canopen.master_node, NmtState.OPERATIONAL)

    def send(self, messages: list[Frame]) -> None:
        """Send frames as they are."""
        self._link.send(messages)

    def wait(self, until_s: float) -> None:
        """Take frames until a time of the clock."""
        while (left := until_s - self.clock()) > 0:
            frame = self._link.receive(left)
            if frame is not None:
                self._on_frame(frame, in_cycle=False)

    # -- a cycle -----------------------------------------------------------------------------------

    def _cycle(self, setpoint_pa: Array | None) -> list[Fault]:
        """Send set points, or zeros for None, and judge what comes back."""
        self._cycles += 1
        if self._bus_off is not None or self._link.is_bus_off:
            self._bus_off = self._bus_off or Fault(
                "bus_off", "bus", "the adapter is off the bus", latched=True
            )
            self.sent_pa = self._zeros.copy()
            for node in self._nodes:
                node.begin_cycle(self.now_ns)
            return list(self.latched)
        if setpoint_pa is None:
            rpdos = self._zero_frames()
        else:
            self._zero_rounds = 0
            counts = self._counts(setpoint_pa)
            rpdos = [self._rpdo(n, Control.ACTIVE, c) for n, c in zip(self._nodes, counts, strict=True)]
        self._transact(rpdos)
        faults: list[Fault] = []
        for node in self._nodes:
            self._lost += not node.fresh
            faults += node.end_cycle(self.now_ns, setpoint_pa is not None, self.platform)
        return faults

    def _transact(self, rpdos: list[Frame]) -> None:
        """RPDOs and SYNC out, TPDOs in."""
        link = self._link
        for node in self._nodes:
            node.begin_cycle(self.now_ns)
        period_ns = round(self.platform.canopen.heartbeat_s * 1e9)
        if self._heartbeat_ns is None or self.now_ns - self._heartbeat_ns >= period_ns:
            self._heartbeat_ns = self.now_ns
            rpdos = [self.own_heartbeat(), *rpdos]
        link.send([*rpdos, frames.SYNC])
        start = self.clock()
        while waiting := [node for node in self._nodes if not node.fresh and not node.gone]:
            frame = link.receive(max(start + self._budget_s(waiting) - self.clock(), 0.0))
            if frame is None:
                return
            self._on_frame(frame, in_cycle=True)

    def _budget_s(self, waiting: list[NodeMonitor]) -> float:
        """Time for the answers; in lockstep a node that is known to be silent does not hold up the others."""
        if self.lockstep and any(node.missed < self.platform.canopen.stale_cycles for node in waiting):
            return self.platform.lockstep_timeout_s
        return self.platform.cycle_budget_s

    def _drain(self) -> None:
        while (frame := self._link.receive(0.0)) is not None:
            self._on_frame(frame, in_cycle=False)

    def _on_frame(self, frame: Frame, in_cycle: bool) -> None:
        if frame.extended or frame.remote:
            return
        can_id = frame.can_id
        if node := self._by_tpdo.get(can_id):
            node.on_reading(frame.data, self.now_ns, in_cycle)
        elif node := self._by_heartbeat.get(can_id):
            node.on_heartbeat(frame.data, self.now_ns)
        elif node := self._by_emcy.get(can_id):
            node.on_emergency(frame.data)

    def _refuse(self, setpoint_pa: Array) -> list[Fault]:
        allowed = self.platform.range
        slack = 1e-6 * (allowed.maximum_pa - allowed.minimum_pa)  # rounding of a limiter's arithmetic
        good = (setpoint_pa >= allowed.minimum_pa - slack) & (setpoint_pa <= allowed.maximum_pa + slack)
        return [
            Fault(
                "refused_setpoint", self._names[n], f"{setpoint_pa[n]} Pa is not within the platform's range"
            )
            for n in np.flatnonzero(~good)  # a comparison with NaN is false, so NaN is refused here
        ]

    def _counts(self, setpoint_pa: Array) -> list[int]:
        """Set points in the devices' counts, and in `sent_pa` what they mean."""
        counts = []
        sent = np.zeros(self.n_chambers)
        for n, node in enumerate(self._nodes):
            if node.scaling is None:
                raise HardwareError(f"{node.source}: not configured")
            scaling = node.scaling
            counts.append(min(max(round(setpoint_pa[n] / scaling.setpoint_pa), scaling.low), scaling.high))
            sent[n] = counts[n] * scaling.setpoint_pa
        self.sent_pa = sent
        return counts

    def _zero_frames(self) -> list[Frame]:
        """Set point 0 for every node: at first in ACTIVE where that is the state, from then on in HOLD."""
        first = self._zero_rounds == 0
        self._zero_rounds += 1
        self.sent_pa = self._zeros.copy()
        rpdos = [
            self._rpdo(n, Control.ACTIVE if first and n.active else Control.HOLD, 0) for n in self._nodes
        ]
        for node in self._nodes:
            node.stand_down()
        return rpdos

    def _rpdo(self, node: NodeMonitor, control: Control, counts: int) -> Frame:
        return Frame(frames.RPDO_BASES[0] + node.node, startup.RPDO_LAYOUT.pack((control, counts)))
