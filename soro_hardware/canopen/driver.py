"""Driver for pressure regulators on CANopen (CiA 301, CiA 408): nodes of one or more channels.

A cycle is: the RPDOs of every node (set points, and control words if they are mapped), SYNC, the TPDOs of
every node (pressures sampled at that SYNC). The platform's mapping defines these objects. The watchdogs of
the devices keep the arm safe when this process ends: heartbeat consumer and RPDO deadline, which the start-up
arms last. Both start with the first frame that they watch, so that a configured arm may wait at 0 Pa for its
first exchange for any time.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping

import can
import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import HardwareError
from soro_hardware.canopen import frames
from soro_hardware.canopen.boot import startup, watchdogs
from soro_hardware.canopen.boot.bring_up import bring_up
from soro_hardware.canopen.cia408 import Control
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.device import check_sync_period, describe
from soro_hardware.canopen.frames import NmtCommand
from soro_hardware.canopen.monitor import NodeMonitor
from soro_hardware.canopen.node_bus import NodeBus
from soro_hardware.canopen.probe import probe
from soro_hardware.canopen.sdo_client import SdoClient, SdoError
from soro_hardware.driver import Driver
from soro_hardware.finding import Finding
from soro_hardware.port import Fault
from soro_hardware.transport.bus_watch import BusWatch
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.link import CanLink
from soro_hardware.transport.open import open_bus

_TEST_S = 1.0  # time for the reports of devices whose host is lost, in the test of their watchdogs


class CanopenRegulator(Driver[CanopenPlatform]):
    """Regulators of one arm on CANopen.

    Parameters
    ----------
    platform : CanopenPlatform
        Valves, range and times.
    open_bus : callable
        Opens the bus; `configure` calls it.
    clock : callable
        Returns a monotonic time [s].
    lockstep : bool
        Whether the cycles advance the time of the devices.
    endpoint : str, optional
        Path or address that `open_bus` opens in place of the platform's device, for findings.
    """

    source = "bus"

    def __init__(
        self,
        platform: CanopenPlatform,
        open_bus: Callable[[], can.BusABC],
        clock: Callable[[], float],
        lockstep: bool = False,
        endpoint: str | None = None,
    ) -> None:
        super().__init__(platform, platform.canopen, clock, lockstep)
        check_sync_period(platform)
        self._endpoint = endpoint
        self.link = CanLink(open_bus)
        self.device = describe(platform.canopen.mapping)
        self.device_watchdog = self.device.has_watchdog
        self.kind = f"canopen: {self.device.mapping.device}"
        self.nodes = [
            NodeMonitor(node, self.device, of_node, self.latch) for node, of_node in platform.nodes.items()
        ]
        self._bus = NodeBus(platform, self.nodes, self.link, clock, lockstep)
        self._watch = BusWatch(self.link, clock)
        by_chamber = {channel.chamber: (node, channel) for node in self.nodes for channel in node.channels}
        self._nodes_of = [by_chamber[name][0] for name in self._names]
        self._channels = [by_chamber[name][1] for name in self._names]
        self._sources = tuple(channel.source for channel in self._channels)
        self._control = Control.ACTIVE
        self._zero_rounds = 0  # rounds of zeros since the last set point
        self._follows = self._rests = False

    @property
    def latched(self) -> tuple[Fault, ...]:
        bus = () if self._watch.fault is None else (self._watch.fault,)
        return (*bus, *self.latch.values())

    def counts(self) -> Mapping[str, int]:
        nodes, counts = self.nodes, self.link.counts
        return {
            "frames_sent": self.link.sent,
            "frames_received": self.link.received,
            "frames_late": sum(node.late for node in nodes),
            "frames_garbled": counts["garbled"] + sum(node.garbled for node in nodes),
            "frames_refused": counts["refused"],
            "emergencies": sum(node.emergencies for node in nodes),
            "bus_errors": counts["errors"],
        }

    def probe(self) -> Iterator[Finding]:
        return probe(self.platform, self.device, self.link, self.clients(), self._endpoint, self.clock)

    def clients(self) -> list[tuple[int, SdoClient]]:
        """Return the node ids with their SDO clients."""
        return [(node.node, self._bus.client(node)) for node in self.nodes]

    def start_up(self) -> None:
        self._bus.restart()
        self._watch.open()
        startup.warn_of_unwatched(self.device)
        for node in self.nodes:
            node.restart()
        bring_up(self._bus, self.platform, self.device)
        if self.latched:
            first, *others = self.latched
            rest = "".join(f"; {f.source}: start-up: {f.message}" for f in others)
            raise HardwareError(first.message + rest, first.source, "refused", "start-up")
        self._forget_setpoints()
        self._watch.configured()

    def test_watchdogs(self) -> None:
        if not self.device.has_watchdog:
            return
        self._send_zeros(*self._bus.signs_of_life())  # the watches start with these messages
        limit_s = self.platform.canopen.heartbeat_consumer_s + _TEST_S
        self._bus.wait_for(lambda: all(node.has_lost_host for node in self.nodes), limit_s)
        for node in self.nodes:
            if not node.has_lost_host:
                text = f"test at 0 Pa: the device reports no lost host in {limit_s:g} s of silence"
                raise HardwareError(text, node.source, "refused", "start-up")
        self.latch.clear()
        self.start_up()

    def transfer(self, setpoint_pa: Array, is_vent: bool) -> Flags | bool:
        self._bus.now_ns = self._now_ns
        self._follows = False
        if not self._watch.usable():
            return self._silence()
        try:
            self._bus.drain()
            # A frame since the last cycle may have latched a fault. `shut_down` sets its own control words.
            is_vent = is_vent or bool(self.latched and not self._closed)
            self._follows = not is_vent
            if is_vent:
                self._ask_zeros()
            else:
                asked = zip(self._channels, setpoint_pa.tolist(), strict=True)
                self.sent_pa = np.array([channel.ask(value, self._control) for channel, value in asked])
                self._zero_rounds = 0
            for node in self.nodes:
                node.begin_cycle(self._now_ns)
            # With the heartbeat all RPDOs are sent, also unchanged ones.
            signs, is_due = self._bus.due_signs()
            rpdos = [frame for node in self.nodes for frame in node.rpdos(repeat=is_due)]
            self.link.send([*signs, *rpdos, frames.SYNC])
            self._take_answers()
        except HardwareError as error:
            self._watch.broke(error)
            raise
        if not self._watch.usable():  # bus-off in this cycle
            return self._silence()
        self._take_pressures()
        return np.array([channel.fresh for channel in self._channels])

    def judge(self) -> Iterable[Fault]:
        if self._watch.fault is not None:
            return
        for node in self.nodes:
            self.answers_lost += len(node.awaited)
            yield from node.end_cycle(self._now_ns, self._follows, self.platform)

    def supply_pa(self) -> Array | None:
        if self.device.mapping.supply is None:
            return None
        return np.array([node.supply_pa for node in self._nodes_of])

    def send_zeros(self) -> None:
        if self.device_watchdog and self._watch.fault is not None:
            return
        if not (self.device_watchdog or self._closed):
            with contextlib.suppress(HardwareError):
                self._watch.usable()  # opens a lost bus again
        if not self.link.is_open or self.link.is_bus_off:
            return
        # In lockstep a round advances the devices by one cycle: each call makes one, and the caller repeats.
        for _ in range(1 if self.lockstep else 2):
            # The watchdogs of the devices vent when the bus is lost.
            with contextlib.suppress(HardwareError):
                self._bus.drain()
            with contextlib.suppress(HardwareError):
                self._send_zeros(*self._bus.signs_of_life())

    def on_lost(self, error: HardwareError) -> None:
        raise error

    @property
    def is_open(self) -> bool:
        return self._watch.fault is None

    def wait(self, duration_s: float) -> None:
        end_s = self.clock() + duration_s  # also while frames arrive without a pause
        self._bus.wait_for(lambda: self.clock() >= end_s, duration_s)

    def begin_end(self) -> None:
        if self.latched or not self.sent_pa.any():
            self._control = Control.HOLD

    def shut_down(self, is_empty: bool) -> None:
        """Control words 3, 1, 0, and NMT stop."""
        for word in (Control.HOLD, Control.DISABLED, Control.INIT) if self.device.has_states else ():
            self._control = word
            self.paced(np.zeros(self.n_chambers))
        # The host stops its messages here. To avoid a fault in every valve, PRE_OPERATIONAL ends the set
        # point deadline, and `disarm` switches off the watch of the host.
        self._bus.command(NmtCommand.PRE_OPERATIONAL, *self.nodes)
        with self._bus:
            for node in self.nodes:
                self._bus.beat()
                with contextlib.suppress(SdoError):
                    watchdogs.disarm(self._bus.client(node), self.platform, self.device)
                self._bus.command(NmtCommand.STOP, node)
        self._rests = True

    def disconnect(self) -> None:
        if not self._rests and (self._configured or not self.device_watchdog):
            self.send_zeros()
        self.link.close()

    # -- a cycle -----------------------------------------------------------------------------------

    def _silence(self) -> bool:
        """Make a cycle without a bus, or on a reopened bus before `configure`."""
        self._forget_setpoints()
        if self.link.is_open and not self.device_watchdog:
            # Devices without a watchdog get zeros as soon as the bus is open again.
            try:
                self._bus.drain()
                self._send_zeros()
            except HardwareError as error:
                self._watch.broke(error)
        for node in self.nodes:
            node.begin_cycle(self._now_ns)
        self._take_pressures()
        return False

    def _take_answers(self) -> None:
        """Process frames until the TPDOs of all nodes have arrived or their time is over."""
        start = self.clock()
        while waiting := [node for node in self.nodes if node.awaited and not node.gone]:
            left = start + self._budget_s(waiting) - self.clock()
            # Other frames without end: by then every reading is stale.
            if left < -self.platform.canopen.stale_s or (frame := self.link.receive(max(left, 0.0))) is None:
                return
            self._bus.take(frame, in_cycle=True)

    def _budget_s(self, waiting: list[NodeMonitor]) -> float:
        """Return the time for the answers [s]; in lockstep it is short if only silent nodes are missing."""
        if self.lockstep and any(node.missed < self.platform.canopen.stale_cycles for node in waiting):
            return self.platform.lockstep_timeout_s
        return self.platform.cycle_budget_s

    def _send_zeros(self, *signs: Frame) -> None:
        """Send all RPDOs with zeros, and SYNC."""
        self._ask_zeros()
        rpdos = [frame for node in self.nodes for frame in node.rpdos(repeat=True)]
        self.link.send([*signs, *rpdos, frames.SYNC])

    def _ask_zeros(self) -> None:
        for channel in self._channels:
            channel.ask_zero(is_first=self._zero_rounds == 0)
        self._zero_rounds += 1
        self.sent_pa = np.zeros(self.n_chambers)

    def _forget_setpoints(self) -> None:
        self._zero_rounds, self.sent_pa = 0, np.zeros(self.n_chambers)

    def _take_pressures(self) -> None:
        self.pressure_pa = np.array([channel.pressure_pa for channel in self._channels])

    def _late(self, fresh: Flags) -> list[Fault]:
        return [] if self._watch.fault is not None else super()._late(fresh)


def open_driver(
    platform: CanopenPlatform, endpoint: str | None, clock: Callable[[], float], lockstep: bool
) -> CanopenRegulator:
    """Make the driver of a platform; parameters as in `Family.open`."""
    return CanopenRegulator(
        platform, lambda: open_bus(platform.transport, endpoint, lockstep), clock, lockstep, endpoint
    )
