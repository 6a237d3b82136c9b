"""Emulated CANopen devices of a platform: bus, nodes and air."""

from __future__ import annotations

from collections.abc import Callable

from soro_hardware.canopen import frames, sdo_frames
from soro_hardware.canopen.cia408 import ValveState
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.device import describe
from soro_hardware.canopen.frames import SYNC_ID, EmcyCode
from soro_hardware.canopen.sdo_frames import SdoAbort
from soro_hardware.emulation.canopen.adapter import (
    Adapter,
    RememberingSlcanServer,
    SilentSlcanServer,
    SlcanServer,
    SocketcandServer,
)
from soro_hardware.emulation.canopen.hub import BusController, Hub
from soro_hardware.emulation.canopen.node import EmulatedNode
from soro_hardware.emulation.devices import EmulatedDevices
from soro_hardware.emulation.faults.line_faults import ON_BYTES
from soro_hardware.emulation.faults.schedule import FaultSchedule
from soro_hardware.transport.frame import Frame

ON_ADAPTER_LINE = frozenset({"truncate", "garbage_line"})
ON_FRAMES = ON_BYTES - ON_ADAPTER_LINE | {"bus_off", "ack_missing", "babble"}
OF_NODES = frozenset(
    {
        "reboot",
        "brownout",
        "mute",
        "freeze_tpdo",
        "wrong_node_id",
        "sdo_abort",
        "sdo_timeout",
        "overheat",
        "supply_rise",
    }
)
_TPDO_FIRST, _TPDO_LAST = frames.TPDO_BASES[0], frames.TPDO_BASES[-1] + 0x7F


class NodeFaults:
    """Effects of faults on one node; it stands between the node and the bus.

    Parameters
    ----------
    faults : FaultSchedule
        Active faults.
    chambers : tuple of str
        Chambers of the node: a device fault of any of them is a fault of the node.
    to_bus : callable
        Sends a frame to the bus.
    """

    def __init__(
        self, faults: FaultSchedule, chambers: tuple[str, ...], to_bus: Callable[[Frame], object]
    ) -> None:
        self._faults, self._chambers, self._to_bus = faults, chambers, to_bus
        self._sent: dict[int, bytes] = {}
        self._powered = True

    def send(self, frame: Frame) -> None:
        """Pass a frame of the node to the bus."""
        passed = self._outgoing(frame) if self._faults.is_active else frame
        if passed is not None:
            if _TPDO_FIRST <= frame.can_id <= _TPDO_LAST:
                self._sent[frame.can_id] = passed.data
            self._to_bus(passed)

    def receive(self, frame: Frame, now_ns: int) -> None:
        """Pass a frame of the bus to the node."""
        passed = self._incoming(frame) if self._faults.is_active else frame
        if self._powered and passed is not None:
            self._node.receive(passed, now_ns)

    def _outgoing(self, frame: Frame) -> Frame | None:
        """Return the frame that reaches the bus when the node sends `frame`, or None."""
        if not self._powered or self._value("mute") is not None:
            return None
        is_reply = frame.can_id & ~0x7F == sdo_frames.SDO_RESPONSE
        if is_reply and self._value("sdo_timeout") is not None:
            return None
        if is_reply and self._value("sdo_abort") is not None:
            frame = Frame(
                frame.can_id, b"\x80" + frame.data[1:4] + SdoAbort.DEVICE_STATE.to_bytes(4, "little")
            )
        if self._value("freeze_tpdo") is not None and frame.can_id in self._sent:
            frame = Frame(frame.can_id, self._sent[frame.can_id])
        node = self._value("wrong_node_id")
        return frame if node is None else frame._replace(can_id=frame.can_id & ~0x7F | int(node))

    def _incoming(self, frame: Frame) -> Frame | None:
        """Return the frame that reaches the node; one with a wrong node id receives those of that id."""
        node = self._value("wrong_node_id")
        if node is None or frame.can_id & 0x7F == 0 or frame.can_id >= frames.HEARTBEAT_BASE:
            return frame
        own = frame.can_id & 0x7F == int(node)
        return None if not own else frame._replace(can_id=frame.can_id & ~0x7F | self._node_id)

    def attach(self, node: EmulatedNode) -> None:
        """Set the node."""
        self._node, self._node_id = node, node.node

    def reboot(self, now_ns: int) -> None:
        """Restart the node as after a loss of power."""
        self._node.reset(now_ns)

    def overheat(self, is_on: bool) -> None:
        """Report the temperature of the fault, or again its own."""
        self._node.celsius = self._value("overheat") if is_on else None

    def power(self, is_on: bool, now_ns: int) -> None:
        """Switch the power of the node."""
        if not is_on:  # the node reports the falling supply before it is off
            self._node.fault(EmcyCode.SUPPLY_LOW, 1, ValveState.FAULT_DISABLED)
        self._powered = is_on
        if is_on:
            self.reboot(now_ns)

    def _value(self, fault: str) -> float | None:
        found = (self._faults.value(fault, chamber) for chamber in self._chambers)
        return next((value for value in found if value is not None), None)


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

    def add_adapter(self, kind: type[Adapter]) -> Adapter:
        """Add an adapter to the bus; the first one uses the controller `host`."""
        controller = self.hub.attach(lambda *_: None) if self.lines else self.host
        adapter = kind(lambda frame: self.send(controller, frame))
        controller.receive, controller.report = adapter.deliver, adapter.report
        adapter.rejoin = lambda: self.hub.rejoin(controller)
        self.add_line(adapter)
        return adapter

    def send(self, controller: BusController, frame: Frame) -> bool:
        """Send a frame of the host or another adapter; in lockstep a SYNC ends the cycle."""
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
        faults = NodeFaults(
            self.faults, chambers, lambda frame: self.hub.send(controller, frame, self.now_ns)
        )
        supply_pa = max(platform.emulation.supply_pa, platform.range.maximum_pa + _SUPPLY_MARGIN_PA)
        emulated = EmulatedNode(node, self._device, platform.emulation, faults.send, boot_delay_ns, supply_pa)
        faults.attach(emulated)
        controller = self.hub.attach(faults.receive)
        controller.report = lambda errors, _: emulated.bus_off(errors.is_off, self.now_ns)
        return emulated, faults


def emulate(platform: CanopenPlatform, lockstep: bool, seed: int) -> World:
    """Make the emulated devices of a platform with its adapters; parameters as in `families.emulate`."""
    world = World(platform, lambda frame: None, lockstep, seed)
    usual = "socketcand" if platform.transport.kind == "socketcand" else "slcan"
    for name in platform.emulation.adapters or (usual,):
        world.add_adapter(_ADAPTERS[name])
    return world
