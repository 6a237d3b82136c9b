"""Driver for pressure regulators on CANopen (CiA 301, CiA 408): nodes of one or more channels.

A cycle is: the RPDOs of every node (set points, and control words where they are mapped beside them), SYNC,
the TPDOs of every node (pressures sampled at that SYNC); the platform's mapping says which objects these are.
What keeps the arm safe when this process ends in any way are the devices' own watchdogs, which the start-up
arms: heartbeat consumer and RPDO deadline. Both begin to count with the first frame that they watch, so that
a configured arm may wait any time for its first exchange, holding 0 Pa.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import can
import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.canopen import frames, shutdown, startup
from soro_core.hardware.canopen.cia408 import Control
from soro_core.hardware.canopen.config import CanopenPlatform
from soro_core.hardware.canopen.device import describe
from soro_core.hardware.canopen.dispatch import Dispatch
from soro_core.hardware.canopen.frames import NmtCommand, NmtState
from soro_core.hardware.canopen.guarding import Guarding
from soro_core.hardware.canopen.monitor import NodeMonitor
from soro_core.hardware.canopen.probe import probe
from soro_core.hardware.canopen.sdo_client import SdoClient
from soro_core.hardware.canopen.setpoints import Setpoints
from soro_core.hardware.driver_base import DriverBase
from soro_core.hardware.finding import Finding
from soro_core.hardware.port import Array, BusStatistics, Exchange, Fault
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.guard import BusGuard
from soro_core.hardware.transport.link import CanLink
from soro_core.hardware.transport.open import open_bus


class CanopenRegulator(DriverBase[CanopenPlatform]):
    """Regulators of one arm on CANopen.

    Parameters
    ----------
    platform : CanopenPlatform
        Valves, range and times.
    open_bus : callable
        Opens the bus; called by `configure`.
    clock : callable
        Monotonic time [s] for the limits of blocking steps.
    lockstep : bool
        Wait for every answer, pace nothing.
    endpoint : str, optional
        What `open_bus` opens in place of the platform's device; only named in findings.
    """

    def __init__(
        self,
        platform: CanopenPlatform,
        open_bus: Callable[[], can.BusABC],
        clock: Callable[[], float],
        lockstep: bool = False,
        endpoint: str | None = None,
    ) -> None:
        super().__init__(platform, clock, lockstep)
        self._endpoint = endpoint
        self._link = CanLink(open_bus)
        self.device = describe(platform.canopen.mapping)
        self.device_watchdog = self.device.has_watchdog
        self._nodes = [NodeMonitor(node, self.device, of_node) for node, of_node in platform.nodes.items()]
        self._setpoints = Setpoints(platform, self._nodes)
        self._dispatch = Dispatch(self._nodes, self.device)
        self._heartbeat_ns: int | None = None
        self._guard = BusGuard(self._link, clock)
        self._own_heartbeat = frames.heartbeat(platform.canopen.master_node, NmtState.OPERATIONAL)
        self._guarding = Guarding(self._nodes, platform.canopen.heartbeat_s)
        self._lost = self.now_ns = 0

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
    def sent_pa(self) -> Array:
        """Set points as they went out last [Pa gauge]."""
        return self._setpoints.sent_pa

    @property
    def latched(self) -> tuple[Fault, ...]:
        """Faults that only `configure` clears."""
        bus = () if self._guard.fault is None else (self._guard.fault,)
        return bus + tuple(fault for node in self._nodes for fault in node.latched)

    def probe(self) -> Iterator[Finding]:
        return probe(self.platform, self.device, self._link, self.clients(), self._endpoint, self.clock)

    def configure(self) -> None:
        self._begin()
        self._heartbeat_ns = None
        self._guard.open()
        startup.tell_unwatched(self.device)
        for node in self._nodes:
            node.restart()
        clients = [self.client(node) for node in self._nodes]
        times, link = self.platform.canopen, self._link
        # A node that runs on from a former session stops exchanging values, and vents.
        link.send([frames.nmt(NmtCommand.PRE_OPERATIONAL, node.node) for node in self._nodes])
        for client in clients:
            startup.wait_for_boot(client, times.boot_timeout_s)
        for node, client in zip(self._nodes, clients, strict=True):
            node.configured = True  # from here on a boot-up is a fault
            channels = tuple(channel.channel for channel in node.channels)
            scalings = startup.configure_node(client, node.node, channels, self.platform, self.device)
            for channel, scaling in zip(node.channels, scalings, strict=True):
                channel.scaling = scaling
        link.send([frames.nmt(NmtCommand.START, node.node) for node in self._nodes])
        for node, client in zip(self._nodes, clients, strict=True):
            for channel in node.channels:
                startup.to_hold(client, self.device, channel.channel, times.activation_timeout_s)
        for node in self._nodes:
            node.started()
        if self.latched:
            raise HardwareError("; ".join(f"{f.source}: start-up: {f.message}" for f in self.latched))
        self._setpoints.restart()
        self._configured = True
        self._guard.configured()

    def exchange(self, setpoint_pa: Array, now_ns: int) -> Exchange:
        setpoint, refused = self._checked(setpoint_pa)
        self.now_ns = now_ns
        faults = self._cycle(setpoint, refused) if self._guard.usable() else self._silence()
        return Exchange(
            sent_pa=self.sent_pa.copy(),
            pressure_pa=np.array([channel.pressure_pa for channel in self._setpoints.channels]),
            fresh=np.array([channel.fresh for channel in self._setpoints.channels]),
            faults=(*refused, *faults),
            supply_pa=None if self.device.mapping.supply is None else self._setpoints.supply_pa(),
        )

    def vent(self) -> None:
        if self.device_watchdog and self._guard.fault is not None:
            return
        if self._begun and not (self.device_watchdog or self._closed):
            with contextlib.suppress(HardwareError):
                self._guard.usable()  # opens a lost bus again
        if not self._link.is_open or self._link.is_bus_off:
            return
        # In lockstep a round is a tick of the devices' clock, so there is one a call and the caller repeats.
        for _ in range(1 if self.lockstep else 2):
            # The devices' own watchdogs vent when the bus is gone.
            with contextlib.suppress(HardwareError):
                self._drain()
            with contextlib.suppress(HardwareError):
                self._link.send([*self.signs_of_life(), *self._setpoints.zeros(repeat=True), frames.SYNC])

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        if self._configured and self._guard.fault is None:
            try:
                shutdown.bring_down(self)
            except HardwareError:
                self.vent()
        self._configured = False
        self._link.close()

    # -- for start-up and shutdown -----------------------------------------------------------------

    def command(self, setpoint_pa: Array, control: Control) -> Array:
        """One cycle with a control word for every regulator; pressures, NaN where none came."""
        self._drain()
        self._transact(self._setpoints.frames(setpoint_pa, control))
        return np.array([c.pressure_pa if c.fresh else np.nan for c in self._setpoints.channels])

    def clients(self) -> list[tuple[int, SdoClient]]:
        """Node ids, and their SDO clients."""
        return [(node.node, self.client(node)) for node in self._nodes]

    def client(self, node: NodeMonitor) -> SdoClient:
        """SDO client of one node."""
        times = self.platform.canopen
        return SdoClient(
            self._link,
            node.node,
            node.source,
            on_other=lambda frame: self._on_frame(frame, in_cycle=False),
            clock=self.clock,
            timeout_s=times.sdo_timeout_s,
            retries=times.sdo_retries,
        )

    def signs_of_life(self) -> list[Frame]:
        """Heartbeat of the host, and its questions to the nodes that are guarded."""
        return [self._own_heartbeat, *self._guarding.all()]

    def send(self, messages: list[Frame]) -> None:
        """Send frames."""
        self._link.send(messages)

    def wait(self, until_s: float) -> None:
        """Take frames until a time of the clock."""
        while (left := until_s - self.clock()) > 0:
            if (frame := self._link.receive(left)) is not None:
                self._on_frame(frame, in_cycle=False)

    # -- a cycle -----------------------------------------------------------------------------------

    def _cycle(self, wanted_pa: Array, refused: list[Fault]) -> list[Fault]:
        """Send set points, or zeros where something is wrong, and judge what comes back."""
        try:
            self._drain()
            follow = not (refused or self.latched)
            setpoints = self._setpoints
            self._transact(setpoints.frames(wanted_pa, Control.ACTIVE) if follow else setpoints.zeros)
        except HardwareError as error:
            self._guard.broke(error)
            raise
        if not self._guard.usable():  # the controller went off in this very cycle
            return self._silence()
        faults: list[Fault] = []
        for node in self._nodes:
            self._lost += len(node.awaited)
            faults += node.end_cycle(self.now_ns, follow, self.platform)
        return faults

    def _silence(self) -> list[Fault]:
        """A cycle without a bus, or on one that is back and waits for `configure`."""
        self._setpoints.restart()
        if self._link.is_open and not self.device_watchdog:
            # Nobody else vents these devices, so zeros go out as soon as they can be reached again.
            try:
                self._drain()
                self._link.send([*self._setpoints.zeros(repeat=True), frames.SYNC])
            except HardwareError as error:
                self._guard.broke(error)
        for node in self._nodes:
            node.begin_cycle(self.now_ns)
        return list(self.latched)

    def _transact(self, rpdos: Callable[[bool], list[Frame]]) -> None:
        """RPDOs and SYNC out, TPDOs in; with the heartbeat everything goes out, changed or not."""
        for node in self._nodes:
            node.begin_cycle(self.now_ns)
        period_ns = round(self.platform.canopen.heartbeat_s * 1e9)
        due = self._heartbeat_ns is None or self.now_ns - self._heartbeat_ns >= period_ns
        if due:
            self._heartbeat_ns = self.now_ns
        signs = [*([self._own_heartbeat] if due else ()), *self._guarding.due(self.now_ns)]
        self._link.send([*signs, *rpdos(due), frames.SYNC])
        start = self.clock()
        while waiting := [node for node in self._nodes if node.awaited and not node.gone]:
            left = start + self._budget_s(waiting) - self.clock()
            # Frames of others without end; every reading is stale by then.
            if left < -self.platform.canopen.stale_s or (frame := self._link.receive(max(left, 0.0))) is None:
                return
            self._on_frame(frame, in_cycle=True)

    def _budget_s(self, waiting: list[NodeMonitor]) -> float:
        """Time for the answers; in lockstep a node that is known to be silent does not hold up the others."""
        if self.lockstep and any(node.missed < self.platform.canopen.stale_cycles for node in waiting):
            return self.platform.lockstep_timeout_s
        return self.platform.cycle_budget_s

    def _drain(self) -> None:
        for frame in self._link.waiting():
            self._on_frame(frame, in_cycle=False)

    def _on_frame(self, frame: Frame, in_cycle: bool) -> None:
        self._dispatch.take(frame, self.now_ns, in_cycle)


def open_driver(
    platform: CanopenPlatform, endpoint: str | None, clock: Callable[[], float], lockstep: bool
) -> CanopenRegulator:
    """Make the driver of a platform; `endpoint` takes the place of the adapter's device."""
    return CanopenRegulator(
        platform, lambda: open_bus(platform.transport, endpoint, lockstep), clock, lockstep, endpoint
    )
