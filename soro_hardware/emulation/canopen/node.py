"""An emulated CANopen node: network management, boot-up, heartbeats, emergencies, valves."""

from __future__ import annotations

from collections.abc import Callable

from soro_hardware.canopen import frames, sdo_frames
from soro_hardware.canopen.cia408 import (
    ERROR_BEHAVIOUR,
    ERROR_COMMUNICATION,
    ERROR_GENERIC,
    ERROR_REGISTER,
    GUARD_TIME,
    PRODUCER_HEARTBEAT,
    ValveState,
)
from soro_hardware.canopen.config import CanopenEmulation
from soro_hardware.canopen.device import Device
from soro_hardware.canopen.eds import read_eds
from soro_hardware.canopen.frames import EmcyCode, NmtCommand, NmtState
from soro_hardware.emulation.canopen.dictionary import ObjectDictionary
from soro_hardware.emulation.canopen.pdo_server import MS, Pdos
from soro_hardware.emulation.canopen.sdo_server import SdoServer
from soro_hardware.emulation.canopen.valve import EmulatedValve
from soro_hardware.emulation.canopen.watches import Watches
from soro_hardware.transport.frame import Frame

_STAYS_OPERATIONAL, _STOPS = 1, 2  # object 1029:1, behaviour after a communication error in OPERATIONAL


class EmulatedNode:
    """One node with its valves.

    A communication error lasts until the missing message arrives; a missed set point deadline lasts until the
    communication is reset. During an error the node leaves OPERATIONAL and does not enter it, unless object
    1029:1 allows it (CANopenNode: CO_NMT_Heartbeat.c, CO_PDO.c; CiA 301 has the same default).

    Parameters
    ----------
    node : int
        Node id.
    device : Device
        EDS and mapping of the node.
    emulation : CanopenEmulation
        Behaviour of the emulated device.
    send : callable
        Sends a frame to the bus.
    boot_delay_ns : int
        Time [ns] from power-on to boot-up.
    supply_pa : float
        Supply pressure [Pa gauge].
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
        self.now_ns = 0
        self.valves = [
            EmulatedValve(self.dictionary, device, channel, emulation, lambda: self.now_ns)
            for channel in channels
        ]
        if (supply := device.mapping.supply) is not None:
            self._supply, self._supply_pa = supply, supply_pa
            self.dictionary.on_read[supply.index, supply.sub] = self._supply_counts
        self.celsius: float | None = None  # what it reports; None: the value of its EDS
        if (heat := device.mapping.temperature) is not None:
            self._heat = heat
            self.dictionary.on_read[heat.index, heat.sub] = self._heat_counts
        self.state = NmtState.BOOT_UP
        self._send = send
        self._pdos = Pdos(self.dictionary, send)
        self._sdo = SdoServer(node, self.dictionary)
        self._watches = Watches(self.dictionary)
        self._standing: set[EmcyCode] = set()  # present communication errors, all reported
        self._fault_bits = 0  # bits of the error register for faults of the valves
        self._boot_delay_ns, self._boot_ns = boot_delay_ns, boot_delay_ns
        self._heartbeat_sent_ns = 0
        self._toggle = 0

    @property
    def valve(self) -> EmulatedValve:
        """The first valve, in most nodes the only one."""
        return self.valves[0]

    def receive(self, frame: Frame, now_ns: int) -> None:
        """Process a frame from the bus at a time [ns]."""
        if frame.extended or self.state is NmtState.BOOT_UP:
            return
        self.now_ns = now_ns
        can_id, data = frame.can_id, frame.data
        if frame.remote:
            self._on_remote(can_id)
        elif can_id == frames.NMT_ID:
            self._on_nmt(data)
        elif self.state is NmtState.STOPPED:
            return
        elif can_id == frames.SYNC_ID:
            self._watches.sync(now_ns)
            if self.state is NmtState.OPERATIONAL:
                self._on_sync()
        elif can_id == sdo_frames.SDO_REQUEST + self.node:
            fault = self._is_fault
            reply = self._sdo.serve(data, now_ns)
            if reply is not None:
                self._send(reply)
            self._report_reset(fault)
        elif can_id >= frames.HEARTBEAT_BASE:
            if len(data) == 1:
                self._watches.heartbeat(can_id - frames.HEARTBEAT_BASE, data[0], now_ns)
        elif self.state is NmtState.OPERATIONAL:
            self._on_rpdo(frame)
        self._report()

    def poll(self, now_ns: int) -> None:
        """Process the events due at a time [ns]: boot-up, heartbeats, event-driven PDOs, missed deadlines."""
        self.now_ns = now_ns
        for valve in self.valves:
            valve.poll()
        if self.state is NmtState.BOOT_UP:
            if now_ns >= self._boot_ns:
                self._boot_up()
            return
        period_ns = self._heartbeat_period_ns
        if 0 < period_ns <= now_ns - self._heartbeat_sent_ns:
            # Keep the grid of the period, whatever the times of the polls; start a new grid after a stall.
            self._heartbeat_sent_ns = max(self._heartbeat_sent_ns + period_ns, now_ns - period_ns)
            self._send(frames.heartbeat(self.node, self.state))
        self._watches.poll(now_ns, stopped=self.state is NmtState.STOPPED)
        self._report()
        if self.state is NmtState.OPERATIONAL and self._pdos.poll(now_ns):
            self._stand(EmcyCode.RPDO_TIMEOUT)

    def fault(self, code: int, register: int, end: ValveState) -> None:
        """Put the valves into a fault state and report an emergency.

        Parameters
        ----------
        code : int
            Error code of the emergency.
        register : int
            Bits of the error register.
        end : ValveState
            Fault state after the fault reaction.
        """
        reacting = [valve.fault(end) for valve in self.valves]
        if any(reacting):
            self._fault_bits |= register
            self._emergency(code)

    def bus_off(self, is_off: bool, now_ns: int) -> None:
        """React to bus-off of the controller, and report its end; the valves keep their fault state."""
        self.now_ns = now_ns
        if is_off:
            self._stand(EmcyCode.BUS_OFF_RECOVERED)
        elif EmcyCode.BUS_OFF_RECOVERED in self._standing:
            self._emergency(EmcyCode.BUS_OFF_RECOVERED)
            self._end(EmcyCode.BUS_OFF_RECOVERED)

    def reset(self, now_ns: int, communication_only: bool = False) -> None:
        """Restart as after power-on or a reset command: power-on values of the objects, valves that vent."""
        self.now_ns = now_ns
        for valve in self.valves:
            valve.power_off()
        self.state, self._boot_ns = (
            NmtState.BOOT_UP,
            now_ns + (0 if communication_only else self._boot_delay_ns),
        )
        self.dictionary.reset(communication_only)
        self._pdos.reset()
        self._sdo.reset()
        self._watches.reset()
        self._standing.clear()
        self._fault_bits = self._toggle = 0
        if self._boot_ns <= now_ns:
            self._boot_up()

    def _boot_up(self) -> None:
        self._send(frames.heartbeat(self.node, NmtState.BOOT_UP))
        self._heartbeat_sent_ns = self.now_ns
        self.state = NmtState.PRE_OPERATIONAL
        for valve in self.valves:
            valve.power_on()

    # -- received frames -----------------------------------------------------------------------------

    def _on_nmt(self, data: bytes) -> None:
        parsed = frames.parse_nmt(data)
        if parsed is None or parsed[1] not in (0, self.node):
            return
        if parsed[0] == NmtCommand.START:
            if not self._standing or self._error_behaviour == _STAYS_OPERATIONAL:
                self._enter(NmtState.OPERATIONAL)
                for valve in self.valves:
                    valve.enter_operational()
        elif parsed[0] == NmtCommand.STOP:
            self._leave(NmtState.STOPPED)
        elif parsed[0] == NmtCommand.PRE_OPERATIONAL:
            self._leave(NmtState.PRE_OPERATIONAL)
        elif parsed[0] in (NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION):
            self.reset(self.now_ns, communication_only=parsed[0] == NmtCommand.RESET_COMMUNICATION)

    def _on_sync(self) -> None:
        for valve in self.valves:
            valve.advance()
        fault = self._is_fault
        self._pdos.sync(self.now_ns)
        self._report_reset(fault)

    def _on_rpdo(self, frame: Frame) -> None:
        was_late = self._pdos.is_late
        if not self._pdos.receive(frame, self.now_ns):
            self._emergency(EmcyCode.PDO_TOO_SHORT)
        elif was_late and not self._pdos.is_late:
            self._end(EmcyCode.RPDO_TIMEOUT)

    def _on_remote(self, can_id: int) -> None:
        """Answer a node guarding request, unless the node sends heartbeats."""
        is_request = can_id == frames.HEARTBEAT_BASE + self.node and (GUARD_TIME, 0) in self.dictionary.values
        if is_request and not self._heartbeat_period_ns:
            self._send(frames.guarded(self.node, self.state, self._toggle))
            self._toggle = 1 - self._toggle
            self._watches.guarded(self.now_ns)

    # -- states and errors ---------------------------------------------------------------------------

    def _enter(self, state: NmtState) -> None:
        """Change the state; a node with heartbeats sends one at once (CO_NMT_process)."""
        is_new, self.state = state is not self.state, state
        if is_new and self._heartbeat_period_ns:
            self._heartbeat_sent_ns = self.now_ns
            self._send(frames.heartbeat(self.node, state))

    def _leave(self, state: NmtState) -> None:
        self._pdos.reset()
        for valve in self.valves:
            valve.leave_operational()
        self._enter(state)

    def _report(self) -> None:
        """Report new errors of the watches, and the end of errors."""
        watched = {EmcyCode.HEARTBEAT_LOST, EmcyCode.COMMUNICATION}
        for code in sorted(self._watches.errors - self._standing):
            self._stand(code)
        for code in sorted(self._standing & watched - self._watches.errors):
            self._end(code)

    def _stand(self, code: EmcyCode) -> None:
        """Begin a communication error: put the valves into a fault state, report it, leave OPERATIONAL."""
        if code in self._standing:
            return
        self._standing.add(code)
        for valve in self.valves:
            valve.fault(ValveState.FAULT_DISABLED)
        self._fault_bits |= ERROR_GENERIC if self._is_fault else 0
        self._emergency(code)
        if self.state is NmtState.OPERATIONAL and self._error_behaviour != _STAYS_OPERATIONAL:
            stops = self._error_behaviour == _STOPS
            self._leave(NmtState.STOPPED if stops else NmtState.PRE_OPERATIONAL)

    def _end(self, code: EmcyCode) -> None:
        """End a communication error; the valves keep their fault state."""
        self._standing.discard(code)
        self._emergency(EmcyCode.NO_ERROR)

    def _emergency(self, code: int) -> None:
        register = self._fault_bits | (ERROR_GENERIC | ERROR_COMMUNICATION if self._standing else 0)
        self.dictionary.values[ERROR_REGISTER, 0] = register
        if self.state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL):
            self._send(frames.emergency(self.node, code, register))

    def _report_reset(self, was_fault: bool) -> None:
        if was_fault and not self._is_fault:
            self._fault_bits = 0
            self._emergency(EmcyCode.NO_ERROR)

    @property
    def _is_fault(self) -> bool:
        return any(valve.state.is_fault for valve in self.valves)

    @property
    def _error_behaviour(self) -> int:
        return self.dictionary.values.get((ERROR_BEHAVIOUR, 1), 0)

    @property
    def _heartbeat_period_ns(self) -> int:
        return self.dictionary.values.get((PRODUCER_HEARTBEAT, 0), 0) * MS

    def _heat_counts(self) -> int:
        if self.celsius is None:
            return self.dictionary.values[self._heat.index, self._heat.sub]
        return round(self.celsius / self._heat.celsius_per_count) + self._heat.zero_count

    def _supply_counts(self) -> int:
        left_pa = min(valve.supply_pa(self._supply_pa) for valve in self.valves)
        return round(left_pa / self._supply.pa_per_count) + self._supply.zero_count
