"""An emulated CANopen node: network management, boot-up, heartbeats both ways, emergencies, its valves."""

from __future__ import annotations

from collections.abc import Callable

from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.cia408 import (
    CONSUMER_HEARTBEAT,
    ERROR_BEHAVIOUR,
    ERROR_REGISTER,
    GUARD_TIME,
    LIFE_TIME_FACTOR,
    PRODUCER_HEARTBEAT,
    State,
)
from soro_core.hardware.canopen.config import CanopenEmulation
from soro_core.hardware.canopen.device import Device
from soro_core.hardware.canopen.eds import read_eds
from soro_core.hardware.canopen.frames import EmcyCode, NmtCommand, NmtState
from soro_core.hardware.emulation.dictionary import ObjectDictionary
from soro_core.hardware.emulation.pdo_server import MS, Pdos
from soro_core.hardware.emulation.sdo_server import serve
from soro_core.hardware.emulation.valve import EmulatedValve
from soro_core.hardware.transport.frame import Frame

_GENERIC, _COMMUNICATION = 1 << 0, 1 << 4  # bits of the error register


class EmulatedNode:
    """One node with its valves.

    Parameters
    ----------
    node : int
        Node id.
    device : Device
        Its EDS and mapping.
    emulation : CanopenEmulation
        Behaviour of the device.
    send : callable
        Takes the frames that the node sends.
    boot_delay_ns : int
        Time from power-on to boot-up.
    supply_pa : float
        What the supply has [Pa gauge].
    """

    def __init__(
        self,
        node: int,
        device: Device,
        emulation: CanopenEmulation,
        send: Callable[[Frame], None],
        boot_delay_ns: int,
        supply_pa: float,
    ) -> None:
        self.node = node
        self.dictionary = ObjectDictionary(dict(read_eds(device.mapping.eds_path, node)))
        channels = range(device.mapping.channels)
        self.valves = [EmulatedValve(self.dictionary, device, channel, emulation) for channel in channels]
        if (supply := device.mapping.supply) is not None:
            self._supply, self._supply_pa = supply, supply_pa
            self.dictionary.on_read[supply.index, supply.sub] = self._supply_counts
        self.state = NmtState.BOOT_UP
        self._send = send
        self._pdos = Pdos(self.dictionary, send)
        self._boot_delay_ns, self._boot_ns = boot_delay_ns, boot_delay_ns
        self._heartbeat_sent_ns = 0
        self._consumer_ns: int | None = (
            None  # time of the last heartbeat of the master; None before the first
        )
        self._guarded_ns: int | None = None  # time of the last question of the master
        self._toggle = 0
        for key in ((CONSUMER_HEARTBEAT, 1), (GUARD_TIME, 0), (LIFE_TIME_FACTOR, 0)):
            self.dictionary.on_write[key] = self._restart_watch

    @property
    def valve(self) -> EmulatedValve:
        """The first valve, which in most nodes is the only one."""
        return self.valves[0]

    def receive(self, frame: Frame, now_ns: int) -> None:
        """Take a frame from the bus."""
        if frame.extended or self.state is NmtState.BOOT_UP:
            return
        if frame.remote:
            self._on_remote(frame.can_id, now_ns)
            return
        for valve in self.valves:
            valve.now_ns = now_ns
        can_id, data = frame.can_id, frame.data
        if can_id == frames.NMT_ID:
            self._on_nmt(data, now_ns)
        elif can_id == frames.SYNC_ID:
            if self.state is NmtState.OPERATIONAL:
                for valve in self.valves:
                    valve.advance(now_ns)
                fault = self._is_fault
                self._pdos.sync(now_ns)
                self._report_reset(fault)
        elif can_id == frames.SDO_REQUEST + self.node:
            if self.state is not NmtState.STOPPED:
                fault = self._is_fault
                reply = serve(self.node, self.dictionary, data)
                if reply is not None:
                    self._send(reply)
                self._report_reset(fault)
        elif can_id >= frames.HEARTBEAT_BASE:
            if can_id - frames.HEARTBEAT_BASE == self._consumed()[0] and len(data) == 1:
                self._consumer_ns = now_ns
        elif self.state is NmtState.OPERATIONAL and not self._pdos.receive(frame, now_ns):
            self._emergency(EmcyCode.PDO_TOO_SHORT, _GENERIC | _COMMUNICATION)

    def poll(self, now_ns: int) -> None:
        """Do what is due by time: boot, send heartbeats and event-driven PDOs, notice silence."""
        for valve in self.valves:
            valve.poll(now_ns)
        if self.state is NmtState.BOOT_UP:
            if now_ns >= self._boot_ns:
                self._boot_up(now_ns)
            return
        period_ns = self.dictionary.values.get((PRODUCER_HEARTBEAT, 0), 0) * MS
        if 0 < period_ns <= now_ns - self._heartbeat_sent_ns:
            # On the grid of the period, not of the polls; from now where the grid is left behind.
            self._heartbeat_sent_ns = max(self._heartbeat_sent_ns + period_ns, now_ns - period_ns)
            self._send(frames.heartbeat(self.node, self.state))
        consumed, guarded = self._consumed()[1], self._life_ns()
        silent = self._consumer_ns is not None and now_ns - self._consumer_ns >= consumed > 0
        forgotten = self._guarded_ns is not None and now_ns - self._guarded_ns >= guarded > 0
        if silent or forgotten:
            self._consumer_ns = self._guarded_ns = None
            self.fault(EmcyCode.HEARTBEAT_LOST, _GENERIC | _COMMUNICATION, State.FAULT_DISABLED)
            self._communication_error()
        if self.state is NmtState.OPERATIONAL and self._pdos.poll(now_ns):
            self.fault(EmcyCode.RPDO_TIMEOUT, _GENERIC | _COMMUNICATION, State.FAULT_DISABLED)

    def fault(self, code: int, register: int, end: State) -> None:
        """Report an emergency and let the valves react, ending in one of the fault states."""
        reacting = [valve.fault(end) for valve in self.valves]
        if any(reacting):
            self._emergency(code, register)

    def off_bus(self, now_ns: int) -> None:
        """React to a controller that has taken itself off the bus, which nobody can be told of."""
        for valve in self.valves:
            valve.now_ns = now_ns
            valve.fault(State.FAULT_DISABLED)
        self._communication_error()

    def back_on_bus(self) -> None:
        """Report that the controller has come back; the reaction stays."""
        self._emergency(EmcyCode.BUS_OFF_RECOVERED, _GENERIC | _COMMUNICATION)

    def reset(self, now_ns: int, communication_only: bool = False) -> None:
        """Start anew, as by power or by command: values not stored are lost, the valves vent."""
        for valve in self.valves:
            valve.now_ns = now_ns
            valve.power_off()
        self.state, self._boot_ns = (
            NmtState.BOOT_UP,
            now_ns + (0 if communication_only else self._boot_delay_ns),
        )
        self.dictionary.reset(communication_only)
        self._pdos.reset()
        self._consumer_ns = self._guarded_ns = None
        self._toggle = 0
        if self._boot_ns <= now_ns:
            self._boot_up(now_ns)

    def _boot_up(self, now_ns: int) -> None:
        self._send(frames.heartbeat(self.node, NmtState.BOOT_UP))
        self._heartbeat_sent_ns = now_ns
        self.state = NmtState.PRE_OPERATIONAL
        for valve in self.valves:
            valve.power_on()

    def _on_nmt(self, data: bytes, now_ns: int) -> None:
        parsed = frames.parse_nmt(data)
        if parsed is None or parsed[1] not in (0, self.node):
            return
        if parsed[0] == NmtCommand.START:
            self.state = NmtState.OPERATIONAL
            for valve in self.valves:
                valve.enter_operational()
        elif parsed[0] == NmtCommand.STOP:
            self._leave(NmtState.STOPPED)
        elif parsed[0] == NmtCommand.PRE_OPERATIONAL:
            self._leave(NmtState.PRE_OPERATIONAL)
        elif parsed[0] in (NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION):
            self.reset(now_ns, communication_only=parsed[0] == NmtCommand.RESET_COMMUNICATION)

    def _leave(self, state: NmtState) -> None:
        self.state = state
        self._pdos.reset()
        for valve in self.valves:
            valve.leave_operational()

    def _communication_error(self) -> None:
        behaviour = self.dictionary.values.get((ERROR_BEHAVIOUR, 1), 0)
        if self.state is NmtState.OPERATIONAL and behaviour != 1:  # 1: no change of state
            self._leave(NmtState.STOPPED if behaviour == 2 else NmtState.PRE_OPERATIONAL)

    def _consumed(self) -> tuple[int, int]:
        """Node whose heartbeat is consumed, and the longest silence [ns]."""
        value = self.dictionary.values.get((CONSUMER_HEARTBEAT, 1), 0)
        return value >> 16 & 0x7F, (value & 0xFFFF) * MS

    def _supply_counts(self) -> int:
        left_pa = min(valve.supply_pa(self._supply_pa) for valve in self.valves)
        return round(left_pa / self._supply.pa_per_count) + self._supply.zero_count

    def _restart_watch(self, _: int) -> None:
        self._consumer_ns = self._guarded_ns = None

    def _on_remote(self, can_id: int, now_ns: int) -> None:
        """Answer a question for the state, unless heartbeats are sent in place of it."""
        values = self.dictionary.values
        is_asked = can_id == frames.HEARTBEAT_BASE + self.node and (GUARD_TIME, 0) in values
        if is_asked and not values.get((PRODUCER_HEARTBEAT, 0), 0):
            self._send(frames.guarded(self.node, self.state, self._toggle))
            self._toggle, self._guarded_ns = 1 - self._toggle, now_ns

    def _life_ns(self) -> int:
        values = self.dictionary.values
        return values.get((GUARD_TIME, 0), 0) * values.get((LIFE_TIME_FACTOR, 0), 0) * MS

    def _emergency(self, code: int, register: int) -> None:
        self.dictionary.values[ERROR_REGISTER, 0] = register
        if self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
            self._send(frames.emergency(self.node, code, register))

    @property
    def _is_fault(self) -> bool:
        return any(valve.state.is_fault for valve in self.valves)

    def _report_reset(self, was_fault: bool) -> None:
        if was_fault and not self._is_fault:
            self._emergency(EmcyCode.NO_ERROR, 0)
