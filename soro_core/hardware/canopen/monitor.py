"""What the driver knows of one node and of each of its regulators, and the faults that follow from it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.cia408 import Control, State, state_of
from soro_core.hardware.canopen.config import CanopenPlatform
from soro_core.hardware.canopen.device import Device, Pdo
from soro_core.hardware.canopen.frames import EmcyCode, NmtState
from soro_core.hardware.canopen.pdo import signed
from soro_core.hardware.canopen.startup import Scaling
from soro_core.hardware.port import Fault
from soro_core.hardware.transport.frame import Frame

_SUPPLY_PERIODS = 5
_GONE = frozenset({"rebooted", "left_operational", "heartbeat_lost", "guard_lost"})


@dataclass
class ChannelMonitor:
    """Record of one regulator. Times are those of `Regulator.exchange`, None before the first."""

    chamber: str
    channel: int
    source: str
    has_states: bool
    status_in_cycle: bool
    scaling: Scaling | None = None
    pressure_pa: float = math.nan
    status: int | None = None
    fresh: bool = False
    missed: int = 0
    active: bool = False
    read_ns: int | None = None
    status_ns: int | None = None
    requested_ns: int | None = None
    after: str = ""  # what the node has said of itself, for texts
    latched: dict[str, Fault] = field(default_factory=dict)

    def restart(self) -> None:
        """Forget everything but the last pressure, before the node is configured."""
        self.scaling, self.status, self.fresh, self.missed, self.active = None, None, False, 0, False
        self.read_ns = self.status_ns = self.requested_ns = None
        self.after = ""
        self.latched.clear()

    def stand_down(self) -> None:
        """The regulator is no longer asked to be ACTIVE, as in a vent."""
        self.active, self.requested_ns = False, None
        if not self.status_in_cycle:
            self.status = None  # a status word sent before may still say ACTIVE

    def end_cycle(self, now_ns: int, asked_active: bool, platform: CanopenPlatform) -> list[Fault]:
        """Judge a cycle and return every fault of the regulator."""
        times = platform.canopen
        if asked_active and self.has_states:
            self._follow_state(now_ns, platform)
        faults = list(self.latched.values())
        if not self.fresh:
            self.missed += 1
            age_ns = now_ns - (self.read_ns or now_ns)
            if times.is_stale(self.missed, age_ns):
                faults.append(Fault("stale_reading", self.source, times.too_old(self.missed, age_ns)))
        return faults

    def _follow_state(self, now_ns: int, platform: CanopenPlatform) -> None:
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
        if self.status & 0xF == State.ACTIVE.bits:
            self.active = True
        elif self.active and (self.status_in_cycle or late or state.is_fault):
            # A status word of before the request may come after it where words are sent by event.
            self._latch("not_active", f"fell from active to {state.value[0]}")
        elif state.is_fault or late:
            self._latch("not_active", f"stays in {state.value[0]}")

    def _latch(self, code: str, message: str) -> None:
        self.latched.setdefault(code, Fault(code, self.source, message + self.after, latched=True))


class NodeMonitor:
    """Record of one node.

    Parameters
    ----------
    node : int
        Node id.
    device : Device
        Kind of device.
    chambers : dict
        Chamber of each channel in use.
    """

    def __init__(self, node: int, device: Device, chambers: dict[int, str]) -> None:
        self.node, self.device = node, device
        self.source = f"{', '.join(chambers.values())} (node {node})"
        status_in_cycle = any(
            pdo.cyclic and any(s.kind == "status" for s in pdo.slots) for pdo in device.tpdos
        )
        single = device.mapping.channels == 1
        self.channels = tuple(
            ChannelMonitor(
                chamber,
                channel,
                f"{chamber} (node {node})" if single else f"{chamber} (node {node} channel {channel})",
                device.has_states,
                status_in_cycle,
            )
            for channel, chamber in chambers.items()
        )
        self._by_channel = {monitor.channel: monitor for monitor in self.channels}
        self.configured = self._running = False
        self.awaited: set[int] = set()  # cyclic TPDOs that have not come in this cycle
        self.missed = self.late = self.garbled = self.emergencies = 0
        self.heard_ns: int | None = None
        self._answer: int | None = None  # last state and toggle
        self.supply_pa = math.nan
        self._supply_ns: int | None = None
        self._latched: dict[str, Fault] = {}
        self._supply = device.mapping.supply
        self._cyclic = frozenset(pdo.number for pdo in device.tpdos if pdo.cyclic)
        self._sent: dict[int, bytes] = {}

    @property
    def latched(self) -> list[Fault]:
        """Faults that only the start-up clears."""
        return [*self._latched.values(), *(f for c in self.channels for f in c.latched.values())]

    @property
    def gone(self) -> bool:
        """Whether no answers are to be expected of the node before it is configured again."""
        return not _GONE.isdisjoint(self._latched)

    def restart(self) -> None:
        """Forget everything but counts and the last pressures, before the node is configured."""
        self.configured, self._running, self.missed, self.heard_ns = False, False, 0, None
        self.supply_pa, self._supply_ns = math.nan, None
        self._answer = None
        self._latched.clear()
        self._sent.clear()
        for channel in self.channels:
            channel.restart()

    def started(self) -> None:
        """NMT start has been sent: heartbeats of before it said another state."""
        self._latched.pop("left_operational", None)

    def begin_cycle(self, now_ns: int) -> None:
        """Start a cycle; the time limits begin with the first one."""
        self.awaited = set(self._cyclic)
        if not self._running:
            self._running, self.heard_ns, self._supply_ns = True, now_ns, now_ns
        for channel in self.channels:
            channel.fresh = False
            if channel.read_ns is None:
                channel.read_ns = now_ns

    def rpdos(self, controls: dict[int, Control], counts: dict[int, int], repeat: bool) -> list[Frame]:
        """RPDOs of a cycle; channels not in use are sent control word 0 and the count that means 0 Pa.

        A PDO of control words alone goes out when one has changed, or when `repeat` says so.
        """
        sent = []
        for pdo in self.device.rpdos:
            values = []
            for s in pdo.slots:
                if s.kind == "setpoint":
                    values.append(counts.get(s.channel, self._zero_count()))
                else:
                    values.append(int(controls.get(s.channel, 0)) if s.kind == "control" else s.value)
            data = pdo.layout.pack(tuple(values))
            if pdo.cyclic or repeat or self._sent.get(pdo.number) != data:
                sent.append(Frame(pdo.cob_id(self.node), data))
                self._sent[pdo.number] = data
        return sent

    def on_tpdo(self, pdo: Pdo, data: bytes, now_ns: int, in_cycle: bool) -> None:
        """Take one of the node's TPDOs; readings are fresh if they answer the SYNC of the running cycle."""
        if len(data) < pdo.layout.length or any(c.scaling is None for c in self.channels):
            self.garbled += 1
            return
        for s, mapped, raw in zip(pdo.slots, pdo.layout.objects, pdo.layout.unpack(data), strict=True):
            if s.kind == "supply" and self._supply is not None:
                value = signed(raw, mapped.bits) if s.is_signed else raw
                self.supply_pa = (value - self._supply.zero_count) * self._supply.pa_per_count
                self._supply_ns = now_ns
            if s.kind not in ("status", "reading"):
                continue
            channel = self._by_channel.get(s.channel)
            if channel is None or channel.scaling is None:
                continue
            if s.kind == "status":
                channel.status, channel.status_ns = raw, now_ns
                continue
            channel.pressure_pa = channel.scaling.read_pa(signed(raw, mapped.bits) if s.is_signed else raw)
            if in_cycle:
                channel.fresh, channel.missed, channel.read_ns = True, 0, now_ns
        if in_cycle:
            self.awaited.discard(pdo.number)
        elif self.missed and pdo.cyclic:
            self.late += 1

    def on_state(self, data: bytes, now_ns: int) -> None:
        """Take the node's boot-up, heartbeat, or answer to guarding."""
        if len(data) != 1 or (data[0] == self._answer and self.device.is_guarded):  # the toggle must change
            self.garbled += 1
            return
        self.heard_ns, state = now_ns, data[0] & 0x7F
        self._answer = data[0] if data[0] != NmtState.BOOT_UP else None
        if not self.configured:
            return
        if data[0] == NmtState.BOOT_UP:
            self._latch("rebooted", "booted again and lost its configuration")
        elif state != NmtState.OPERATIONAL:
            self._latch("left_operational", f"communication state 0x{state:02X}{self.channels[0].after}")

    def on_emergency(self, data: bytes) -> None:
        """Take the node's emergency.

        Code 0 says that an error is over, 8140 that a controller is back on the bus: no fault by itself, and
        no end of one. What was missed meanwhile is one, and only the start-up ends that.
        """
        parsed = frames.parse_emergency(data)
        if parsed is None:
            self.garbled += 1
        elif parsed.code != 0:
            self.emergencies += 1
            if parsed.code == EmcyCode.BUS_OFF_RECOVERED:
                for channel in self.channels:
                    channel.after = " after its controller was off the bus"
            elif self.configured:
                self._latch("emergency", f"emergency {frames.emergency_text(parsed.code)}")

    def end_cycle(self, now_ns: int, asked_active: bool, platform: CanopenPlatform) -> list[Fault]:
        """Judge a cycle and return every fault of the node and its regulators."""
        limit_s = platform.canopen.heartbeat_consumer_s
        silent = self.heard_ns is not None and now_ns - self.heard_ns > round(limit_s * 1e9)
        if silent and self.device.has_producer:
            self._latch("heartbeat_lost", f"not heard for {limit_s * 1e3:.0f} ms")
        elif silent and self.device.is_guarded:
            self._latch("guard_lost", f"no answer to node guarding for {limit_s * 1e3:.0f} ms")
        self.missed = self.missed + 1 if self.awaited else 0
        faults = [*self._latched.values(), *self._stale_supply(now_ns, platform.canopen.status_s)]
        for channel in self.channels:
            faults += channel.end_cycle(now_ns, asked_active, platform)
        return faults

    def _stale_supply(self, now_ns: int, period_s: float) -> list[Fault]:
        """A supply pressure that comes no more would make its monitor blind."""
        if self._supply is None or self._supply_ns is None:
            return []
        age_s = (now_ns - self._supply_ns) * 1e-9
        if age_s < _SUPPLY_PERIODS * period_s:
            return []
        return [Fault("stale_reading", self.source, f"no supply pressure for {age_s * 1e3:.0f} ms")]

    def _zero_count(self) -> int:
        scaling = self.channels[0].scaling
        return 0 if scaling is None else scaling.setpoint_zero

    def _latch(self, code: str, message: str) -> None:
        self._latched.setdefault(code, Fault(code, self.source, message, latched=True))
