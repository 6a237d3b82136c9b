"""State of one node and of its regulators, as received, and the faults that follow."""

from __future__ import annotations

import math
from dataclasses import dataclass

from soro_core.errors import HardwareError
from soro_hardware.canopen import frames
from soro_hardware.canopen.cia408 import Control, ValveState, state_of
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.device import Device, Pdo, Scaling
from soro_hardware.canopen.frames import EmcyCode, NmtState
from soro_hardware.canopen.mapping import FixedScaling
from soro_hardware.latch import Latch
from soro_hardware.port import Fault
from soro_hardware.transport.frame import Frame

_SUPPLY_PERIODS = 5
_COMMUNICATION = range(0x8100, 0x8300)  # emergency codes of communication and protocol (CiA 301)
_GONE = frozenset({"rebooted", "left_operational", "heartbeat_lost", "guard_lost"})


@dataclass
class ChannelMonitor:
    """State of one regulator; times are those of `Regulator.exchange` [ns], None before the first message."""

    chamber: str
    channel: int
    source: str
    has_states: bool
    status_in_cycle: bool
    latch: Latch
    default_zero: int  # count that means 0 Pa, before the device's scaling is known
    control: Control = Control.INIT
    counts: int = 0
    scaling: Scaling | None = None
    pressure_pa: float = math.nan
    status: int | None = None
    fresh: bool = False
    active: bool = False
    status_ns: int | None = None
    requested_ns: int | None = None
    after: str = ""  # addition to messages after a report of the node

    def restart(self) -> None:
        """Reset everything but the last pressure, before the configuration of the node."""
        self.scaling, self.status, self.fresh, self.active = None, None, False, False
        self.status_ns = self.requested_ns = None
        self.after = ""

    @property
    def zero(self) -> int:
        """Count that means 0 Pa."""
        return self.default_zero if self.scaling is None else self.scaling.setpoint_zero

    def ask(self, setpoint_pa: float, control: Control) -> float:
        """Set the next set point and control word; return the rounded set point [Pa gauge]."""
        if self.scaling is None:
            raise HardwareError("not configured", self.source, "order")
        self.control = control
        self.counts, sent_pa = self.scaling.rounded(setpoint_pa)
        return sent_pa

    def ask_zero(self, is_first: bool) -> None:
        """Set 0 Pa as the next set point: the first time in ACTIVE if that is the state, then in HOLD."""
        self.control = Control.ACTIVE if is_first and self.active else Control.HOLD
        self.counts = self.zero
        self.active, self.requested_ns = False, None
        if not self.status_in_cycle:
            self.status = None  # an older status word may still show ACTIVE

    def check_state(self, now_ns: int, platform: CanopenPlatform) -> None:
        """Latch a fault if the regulator does not follow the request to be ACTIVE."""
        if not self.has_states:
            return
        limit_ns = round(platform.canopen.activation_timeout_s * 1e9)
        if self.requested_ns is None:
            self.requested_ns = now_ns
        late = now_ns - self.requested_ns > limit_ns
        if self.status_in_cycle:
            if not self.fresh:
                return
        elif now_ns - max(self.status_ns or 0, self.requested_ns) > 3e9 * platform.canopen.status_s:
            self._latch("not_active", "does not report its state")
        if self.status is None:
            return
        state = state_of(self.status)
        # All four bits: M, H and D alone (0111) are the fault reaction.
        if self.status & 0xF == ValveState.ACTIVE.bits:
            self.active = True
        elif self.active and (late or state.is_fault):
            # A status word that answers an earlier message, of a vent say, may arrive after the request.
            self._latch("not_active", f"fell from active to {state.value[0]}")
        elif state.is_fault or late:
            self._latch("not_active", f"stays in {state.value[0]}")

    def _latch(self, code: str, message: str) -> None:
        self.latch.add(code, self.source, message + self.after)


class NodeMonitor:
    """State of one node.

    Parameters
    ----------
    node : int
        Node id.
    device : Device
        Kind of device.
    chambers : dict
        Chamber of each channel in use.
    latch : Latch
        Latch of the driver.
    """

    def __init__(self, node: int, device: Device, chambers: dict[int, str], latch: Latch) -> None:
        self.node, self.device, self._latch = node, device, latch
        self.source = f"{', '.join(chambers.values())} (node {node})"
        status_in_cycle = any(
            pdo.cyclic and any(s.kind == "status" for s in pdo.slots) for pdo in device.tpdos
        )
        single, scaling = device.mapping.channels == 1, device.mapping.scaling
        # For a device that reports its scale, 0 Pa is the count 0.
        zero = scaling.setpoint.zero_count if isinstance(scaling, FixedScaling) else 0
        self.channels = tuple(
            ChannelMonitor(
                chamber,
                channel,
                f"{chamber} (node {node})" if single else f"{chamber} (node {node} channel {channel})",
                device.has_states,
                status_in_cycle,
                latch,
                zero,
            )
            for channel, chamber in chambers.items()
        )
        self._by_channel = {monitor.channel: monitor for monitor in self.channels}
        self.configured = self._running = False
        self.awaited: set[int] = set()  # cyclic TPDOs that are missing in this cycle
        self.missed = self.late = self.garbled = self.emergencies = self.boots = 0
        self.state: int | None = None  # communication state as last reported
        self.last_seen_ns: int | None = None
        self._reports_lost_host = False
        self._answer: int | None = None  # last state and toggle
        self.supply_pa = math.nan
        self._supply_ns: int | None = None
        self._supply, self._temperature = device.mapping.supply, device.mapping.temperature
        self.celsius = math.nan
        self._rpdos = [(pdo, pdo.cob_id(node)) for pdo in device.rpdos]
        self._cyclic = frozenset(pdo.number for pdo in device.tpdos if pdo.cyclic)
        self._sent: dict[int, bytes] = {}

    @property
    def gone(self) -> bool:
        """Whether the node gives no answers until its next configuration."""
        return any((code, self.source) in self._latch for code in _GONE)

    @property
    def has_lost_host(self) -> bool:
        """Whether the node has reported an error of its communication, or has left OPERATIONAL."""
        return self._reports_lost_host or ("left_operational", self.source) in self._latch

    def restart(self) -> None:
        """Reset everything but counts and the last pressures, before the configuration of the node."""
        self.configured, self._running, self.missed, self.last_seen_ns = False, False, 0, None
        self.supply_pa, self._supply_ns, self.celsius = math.nan, None, math.nan
        self._answer, self._reports_lost_host = None, False
        self._sent.clear()
        for channel in self.channels:
            channel.restart()

    def started(self) -> None:
        """Drop the fault `left_operational`, which an old heartbeat may have caused before the start."""
        self._latch.pop(("left_operational", self.source), None)

    def begin_cycle(self, now_ns: int) -> None:
        """Start a cycle at a time [ns]; the first cycle starts the time limits."""
        self.awaited = set(self._cyclic)
        if not self._running:
            self._running, self.last_seen_ns, self._supply_ns = True, now_ns, now_ns
        for channel in self.channels:
            channel.fresh = False

    def rpdos(self, repeat: bool) -> list[Frame]:
        """Return the RPDOs of a cycle; unused channels get control word 0 and the count of 0 Pa.

        A PDO with control words only is returned after a change, or with `repeat`.
        """
        sent = []
        for pdo, cob_id in self._rpdos:
            values = []
            for s in pdo.slots:
                channel = self._by_channel.get(s.channel)
                if s.kind == "setpoint":
                    values.append(self.channels[0].zero if channel is None else channel.counts)
                elif s.kind == "control":
                    values.append(0 if channel is None else int(channel.control))
                else:
                    values.append(s.value)
            data = pdo.layout.pack(tuple(values))
            if pdo.cyclic or repeat or self._sent.get(pdo.number) != data:
                sent.append(Frame(cob_id, data))
                self._sent[pdo.number] = data
        return sent

    def on_tpdo(self, pdo: Pdo, data: bytes, now_ns: int, in_cycle: bool) -> None:
        """Process a TPDO of the node.

        Parameters
        ----------
        pdo : Pdo
            Description of the TPDO.
        data : bytes
            Data of its frame.
        now_ns : int
            Time of the cycle [ns].
        in_cycle : bool
            Whether the TPDO answers the SYNC of the present cycle, so that its readings are fresh.
        """
        if len(data) < pdo.layout.length or any(c.scaling is None for c in self.channels):
            self.garbled += 1
            return
        for s, value in zip(pdo.slots, pdo.layout.unpack(data), strict=True):
            if s.kind == "supply" and self._supply is not None:
                self.supply_pa = (value - self._supply.zero_count) * self._supply.pa_per_count
                self._supply_ns = now_ns
            if s.kind == "temperature" and self._temperature is not None:
                self.celsius = (value - self._temperature.zero_count) * self._temperature.celsius_per_count
            if s.kind not in ("status", "reading"):
                continue
            channel = self._by_channel.get(s.channel)
            if channel is None or channel.scaling is None:
                continue
            if s.kind == "status":
                channel.status, channel.status_ns = value, now_ns
                continue
            channel.pressure_pa = channel.scaling.read_pa(value)
            if in_cycle:
                channel.fresh = True
        if in_cycle:
            self.awaited.discard(pdo.number)
        elif self.missed and pdo.cyclic:
            self.late += 1

    def on_state(self, data: bytes, now_ns: int) -> None:
        """Process a boot-up message, a heartbeat, or an answer to node guarding."""
        if len(data) != 1 or (data[0] == self._answer and self.device.is_guarded):  # the toggle must change
            self.garbled += 1
            return
        self.last_seen_ns, state = now_ns, data[0] & 0x7F
        self.state = state
        self.boots += data[0] == NmtState.BOOT_UP
        self._answer = data[0] if data[0] != NmtState.BOOT_UP else None
        if not self.configured:
            return
        if data[0] == NmtState.BOOT_UP:
            self._add("rebooted", "booted again and lost its configuration")
        elif state != NmtState.OPERATIONAL:
            self._add("left_operational", f"communication state 0x{state:02X}{self.channels[0].after}")

    def on_emergency(self, data: bytes) -> None:
        """Process an emergency; code 0 (end of an error) and 8140 (end of bus-off) are no faults."""
        parsed = frames.parse_emergency(data)
        if parsed is None:
            self.garbled += 1
        elif parsed.code != 0:
            self.emergencies += 1
            self._reports_lost_host |= parsed.code in _COMMUNICATION
            if parsed.code == EmcyCode.BUS_OFF_RECOVERED:
                for channel in self.channels:
                    channel.after = " after its controller was off the bus"
            elif self.configured:
                self._add("emergency", f"emergency {frames.emergency_text(parsed.code)}")

    def end_cycle(self, now_ns: int, asked_active: bool, platform: CanopenPlatform) -> list[Fault]:
        """End a cycle: latch faults of the node and its regulators, and return faults that do not latch.

        Parameters
        ----------
        now_ns : int
            Time of the cycle [ns].
        asked_active : bool
            Whether the cycle has requested ACTIVE.
        platform : CanopenPlatform
            Times.
        """
        limit_s = platform.canopen.heartbeat_consumer_s
        silent = self.last_seen_ns is not None and now_ns - self.last_seen_ns > round(limit_s * 1e9)
        if silent and self.device.has_producer:
            self._add("heartbeat_lost", f"no heartbeat for {limit_s * 1e3:.0f} ms")
        elif silent and self.device.is_guarded:
            self._add("guard_lost", f"no answer to node guarding for {limit_s * 1e3:.0f} ms")
        most = platform.canopen.most_celsius
        if self.celsius > most:  # a comparison with NaN is false
            self._add("over_temperature", f"{self.celsius:.1f} degC, allowed {most:g} degC (most_celsius)")
        self.missed = self.missed + 1 if self.awaited else 0
        for channel in self.channels if asked_active else ():
            channel.check_state(now_ns, platform)
        return self._stale_supply(now_ns, platform.canopen.status_s)

    def _stale_supply(self, now_ns: int, period_s: float) -> list[Fault]:
        """Return a fault if the supply pressure is stale, because its monitor needs it."""
        if self._supply is None or self._supply_ns is None:
            return []
        age_s = (now_ns - self._supply_ns) * 1e-9
        if age_s < _SUPPLY_PERIODS * period_s:
            return []
        return [Fault("stale_reading", self.source, f"no supply pressure for {age_s * 1e3:.0f} ms")]

    def _add(self, code: str, message: str) -> None:
        self._latch.add(code, self.source, message)
