"""Emulated CANopen devices of a platform: bus, nodes and air."""

from __future__ import annotations

from collections.abc import Callable

from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.device import describe
from soro_hardware.canopen.frames import SYNC_ID
from soro_hardware.emulation.canopen.adapter import Adapter
from soro_hardware.emulation.canopen.can_faults import OF_NODES, ON_ADAPTER_LINE, ON_FRAMES, NodeFaults
from soro_hardware.emulation.canopen.hub import BusController, Hub
from soro_hardware.emulation.canopen.node import EmulatedNode
from soro_hardware.emulation.canopen.slcan_server import (
    RememberingSlcanServer,
    SilentSlcanServer,
    SlcanServer,
)
from soro_hardware.emulation.canopen.socketcand_server import SocketcandServer
from soro_hardware.emulation.devices import EmulatedDevices
from soro_hardware.transport.frame import Frame

# Margin [Pa] of the supply above the highest set point, larger than the margin of the supply's monitor.
_SUPPLY_MARGIN_PA = 60e3
_ADAPTERS: dict[str, type[Adapter]] = {
    "slcan": SlcanServer,
    "slcan_silent": SilentSlcanServer,
    "slcan_remembering": RememberingSlcanServer,
    "socketcand": SocketcandServer,
}


class World(EmulatedDevices):
    """Emulated CANopen devices of one platform on their bus; the host is a python-can bus or an adapter.

    In lockstep frames have no duration, and each SYNC of the host advances the time by one cycle after the
    devices have answered it.

    Parameters
    ----------
    platform : CanopenPlatform
        Platform to emulate.
    receive : callable
        Called with each frame that the host's adapter receives.
    lockstep : bool
        Whether each SYNC advances the time.
    seed : int
        Seed of the sensor noise and of random faults.
    """

    line_faults = ON_ADAPTER_LINE

    def __init__(
        self, platform: CanopenPlatform, receive: Callable[[Frame], None], lockstep: bool, seed: int = 0
    ) -> None:
        emulation = platform.emulation
        super().__init__(platform, lockstep, seed)
        self.hub = Hub(0 if lockstep else platform.transport.bitrate)
        self.host = self.hub.attach(lambda frame, _: receive(frame))
        delay_ns = 0 if lockstep else round(emulation.boot_delay_s * 1e9)
        self._device = describe(platform.canopen.mapping)
        by_id = {node: self._attach(node, platform, delay_ns) for node in platform.nodes}
        self.nodes = [node for node, _ in by_id.values()]
        self._valves = [by_id[valve.node][0].valves[valve.channel] for valve in platform.valves]
        self.connect_air([valve.demand_pa for valve in self._valves])
        for number, valve in enumerate(self._valves):
            valve.connect(self.air, number)
        self.hub.connect_faults(self.faults, self.host)
        self.faults.supported |= ON_FRAMES | OF_NODES
        faulty = [by_id[valve.node][1] for valve in platform.valves]
        self.on_fault("reboot", lambda place: faulty[place].reboot(self.now_ns))
        self.while_fault("brownout", lambda place, is_on: faulty[place].power(not is_on, self.now_ns))
        self.while_fault("overheat", lambda place, is_on: faulty[place].overheat(is_on))
        for node in self.nodes:
            node.poll(0)
        self.hub.run(0)

    def host_sends(self, frame: Frame) -> None:
        """Send a frame of the host."""
        self._take(self.host, frame)

    def add_adapter(self, kind: type[Adapter]) -> Adapter:
        """Add an adapter to the bus; the first one uses the controller `host`."""
        controller = self.hub.attach(lambda *_: None) if self.lines else self.host
        adapter = kind(lambda frame: self._take(controller, frame))
        controller.receive, controller.report = adapter.deliver, adapter.report
        adapter.rejoin = lambda: self.hub.rejoin(controller)
        self.add_line(adapter)
        return adapter

    def _take(self, controller: BusController, frame: Frame) -> bool:
        """Send a frame of an adapter; in lockstep a SYNC ends the cycle."""
        taken = self.hub.send(controller, frame, self.now_ns)
        self.hub.run(self.now_ns)
        if self.lockstep and frame.can_id == SYNC_ID and not frame.extended:
            self.end_cycle()
        return taken

    def give_setpoint(self, place: int, pressure_pa: float) -> None:
        self._valves[place].give(pressure_pa, "setpoint")

    def due_ns(self) -> int | None:
        return self.hub.next_event_ns

    def work(self, now_ns: int) -> None:
        self.hub.run(now_ns)

    def poll(self, now_ns: int) -> None:
        for node in self.nodes:
            node.poll(now_ns)

    def _attach(
        self, node: int, platform: CanopenPlatform, boot_delay_ns: int
    ) -> tuple[EmulatedNode, NodeFaults]:
        controller: BusController
        chambers = tuple(platform.nodes[node].values())
        faults = NodeFaults(self.faults, chambers)

        def send(frame: Frame) -> None:
            if (passed := faults.outgoing(frame)) is not None:
                self.hub.send(controller, passed, self.now_ns)

        def receive(frame: Frame, now_ns: int) -> None:
            if (passed := faults.incoming(frame)) is not None:
                emulated.receive(passed, now_ns)

        supply_pa = max(platform.emulation.supply_pa, platform.range.maximum_pa + _SUPPLY_MARGIN_PA)
        emulated = EmulatedNode(node, self._device, platform.emulation, send, boot_delay_ns, supply_pa)
        faults.attach(emulated)
        controller = self.hub.attach(receive)
        controller.report = lambda errors, _: emulated.bus_off(errors.is_off, self.now_ns)
        return emulated, faults


def emulate(platform: CanopenPlatform, lockstep: bool, seed: int) -> World:
    """Make the emulated devices of a platform with its adapters; parameters as in `families.emulate`."""
    world = World(platform, lambda frame: None, lockstep, seed)
    usual = "socketcand" if platform.transport.kind == "socketcand" else "slcan"
    for name in platform.emulation.adapters or (usual,):
        world.add_adapter(_ADAPTERS[name])
    return world
