"""The emulated platform without a process around it: bus, nodes and air, with the time given from outside."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soro_core.hardware.canopen.cia408 import CYCLE_PERIOD
from soro_core.hardware.canopen.config import CanopenPlatform
from soro_core.hardware.canopen.device import describe
from soro_core.hardware.canopen.frames import SYNC_ID
from soro_core.hardware.emulation.adapter import Adapter
from soro_core.hardware.emulation.air import Air
from soro_core.hardware.emulation.can_faults import OF_NODES, ON_ADAPTER_LINE, ON_FRAMES, NodeFaults
from soro_core.hardware.emulation.devices import EmulatedDevices
from soro_core.hardware.emulation.error_counters import ErrorCounters
from soro_core.hardware.emulation.faults import Injection
from soro_core.hardware.emulation.hub import Hub, Port
from soro_core.hardware.emulation.line_faults import LineFaults
from soro_core.hardware.emulation.node import EmulatedNode
from soro_core.hardware.emulation.slcan_server import SlcanServer
from soro_core.hardware.emulation.socketcand_server import SocketcandServer
from soro_core.hardware.transport.frame import Frame

# A healthy supply has more than the highest set point and what the supply's monitor wants beside it.
_SUPPLY_MARGIN_PA = 60e3
_ADAPTERS: dict[str, type[Adapter]] = {"slcan": SlcanServer, "socketcand": SocketcandServer}


class World(EmulatedDevices):
    """Emulated CANopen devices of one platform on their bus; as host it has a python-can bus or an adapter.

    In lockstep frames take no time, and each SYNC of the host, once the devices have answered it, advances
    everything by the communication cycle period that the host has written (object 1006). In real time `run`
    advances to the time that it is given.

    Parameters
    ----------
    platform : CanopenPlatform
        What is emulated.
    receive : callable
        Takes every frame that the host's adapter hears.
    lockstep : bool
        Whether SYNC is the clock.
    seed : int
        Seed of the sensor noise.
    """

    def __init__(
        self, platform: CanopenPlatform, receive: Callable[[Frame], None], lockstep: bool, seed: int = 0
    ) -> None:
        emulation = platform.emulation
        super().__init__((), emulation.step_s)
        self._lockstep = lockstep
        self._default_period_ns = round(1e9 / platform.cycle_hz)
        self.hub = Hub(0 if lockstep else platform.transport.bitrate)
        self.host = self.hub.attach(lambda frame, _: receive(frame))
        delay_ns = 0 if lockstep else round(emulation.boot_delay_s * 1e9)
        self._device = describe(platform.canopen.mapping)
        self._node_faults: list[NodeFaults] = []
        by_id = {node: self._attach(node, platform, delay_ns) for node in platform.nodes}
        self.nodes = list(by_id.values())
        valves = [by_id[valve.node].valves[valve.channel] for valve in platform.valves]
        self.air = Air(emulation.regulator, [v.demand_pa for v in valves], np.random.default_rng(seed))
        for number, valve in enumerate(valves):
            valve.connect(self.air, number)
        self.connect_faults(platform.chamber_names, seed)
        for node in self.nodes:
            node.poll(0)
        self.hub.run(0)

    def connect_faults(self, chambers: tuple[str, ...], seed: int) -> None:
        super().connect_faults(chambers, seed)
        faults = self.faults
        faults.supported |= ON_FRAMES | OF_NODES
        self._line_faults = [LineFaults(faults, line, ON_ADAPTER_LINE) for line in self.lines]
        self.hub.connect_faults(faults, self.host)
        for name in OF_NODES:
            faults.on_start[name], faults.on_end[name] = self._begin, self._end

    def _begin(self, injection: Injection) -> None:
        for node in self._node_faults:
            node.begin(injection)

    def _end(self, injection: Injection) -> None:
        for node in self._node_faults:
            node.end(injection)

    def host_sends(self, frame: Frame) -> None:
        """Take a frame from a host on the bus."""
        self._take(self.host, frame)

    def add_adapter(self, kind: type[Adapter]) -> Adapter:
        """Add an adapter to the bus; the first one is at `host`."""
        port = self.hub.attach(lambda *_: None) if self.lines else self.host
        adapter = kind(lambda frame: self._take(port, frame))
        port.receive, port.report = adapter.deliver, adapter.report
        adapter.rejoin = lambda: self.hub.rejoin(port)
        self.lines = (*self.lines, adapter)
        return adapter

    def _take(self, port: Port, frame: Frame) -> bool:
        """Take a frame from a host's port."""
        taken = self.hub.send(port, frame, self.now_ns)
        self.hub.run(self.now_ns)
        if self._lockstep and frame.can_id == SYNC_ID and not frame.extended:
            self.tick(self.now_ns + self._period_ns())
        return taken

    def due_ns(self) -> int | None:
        return self.hub.next_event_ns

    def work(self, now_ns: int) -> None:
        self.hub.run(now_ns)

    def poll(self, now_ns: int) -> None:
        for node in self.nodes:
            node.poll(now_ns)

    def _period_ns(self) -> int:
        period_us = self.nodes[0].dictionary.values.get((CYCLE_PERIOD, 0), 0)
        return period_us * 1000 if period_us else self._default_period_ns

    def _attach(self, node: int, platform: CanopenPlatform, boot_delay_ns: int) -> EmulatedNode:
        port: Port
        chambers = tuple(platform.nodes[node].values())
        faults = NodeFaults(lambda: self.faults, chambers, lambda: self.now_ns)

        def send(frame: Frame) -> None:
            if (passed := faults.outgoing(frame)) is not None:
                self.hub.send(port, passed, self.now_ns)

        def receive(frame: Frame, now_ns: int) -> None:
            if (passed := faults.incoming(frame)) is not None:
                emulated.receive(passed, now_ns)

        supply_pa = max(platform.emulation.supply_pa, platform.range.maximum_pa + _SUPPLY_MARGIN_PA)
        emulated = EmulatedNode(node, self._device, platform.emulation, send, boot_delay_ns, supply_pa)
        faults.attach(emulated)
        self._node_faults.append(faults)
        port = self.hub.attach(receive)
        was_off = False

        def report(errors: ErrorCounters, _: str) -> None:
            nonlocal was_off
            if errors.is_off and not was_off:
                emulated.off_bus(self.now_ns)
            elif was_off and not errors.is_off:
                emulated.back_on_bus()
            was_off = errors.is_off

        port.report = report
        return emulated


def emulate(platform: CanopenPlatform, lockstep: bool, seed: int) -> World:
    """Emulated devices of a platform behind the adapters that it names, or the one of its transport."""
    world = World(platform, lambda frame: None, lockstep, seed)
    usual = "socketcand" if platform.transport.kind == "socketcand" else "slcan"
    for name in platform.emulation.adapters or (usual,):
        world.add_adapter(_ADAPTERS[name])
    return world
