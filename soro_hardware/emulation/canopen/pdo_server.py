"""PDOs of an emulated node: mapping rules, synchronous and event-driven transmission, deadlines."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace

from soro_hardware.canopen.cia408 import (
    RPDO_COMMUNICATION,
    RPDO_MAPPING,
    TPDO_COMMUNICATION,
    TPDO_MAPPING,
)
from soro_hardware.canopen.device import Mapped, PdoLayout
from soro_hardware.canopen.frames import COB_DISABLED
from soro_hardware.canopen.sdo_frames import SdoAbort
from soro_hardware.emulation.canopen.dictionary import ObjectDictionary, Refused
from soro_hardware.transport.frame import Frame

MS = 1_000_000
_NEVER_SENT = -(10**18)


@dataclass
class _Pdo:
    communication: int
    mapping: int
    receive: bool
    layout: PdoLayout | None = None  # from the mapping object; None after a change of it
    # Reception: data that waits for the next SYNC, and time of the last PDO (None: no deadline yet).
    pending: bytes | None = None
    received_ns: int | None = None
    missed: bool = False
    # Transmission: number of SYNCs since the last PDO, its time, and its data.
    syncs: int = 0
    sent_ns: int = _NEVER_SENT
    sent_data: bytes | None = None


class Pdos:
    """All PDOs of one node.

    Parameters
    ----------
    dictionary : ObjectDictionary
        Its communication and mapping records configure the PDOs; every write to them is checked.
    send : callable
        Sends a frame to the bus.
    """

    def __init__(self, dictionary: ObjectDictionary, send: Callable[[Frame], None]) -> None:
        self._dictionary, self._send = dictionary, send
        self._all = [
            _Pdo(base + n, mapping + n, receive)
            for base, mapping, receive in (
                (RPDO_COMMUNICATION, RPDO_MAPPING, True),
                (TPDO_COMMUNICATION, TPDO_MAPPING, False),
            )
            for n in range(4)
            if (base + n, 1) in dictionary.entries
        ]
        for pdo in self._all:
            self._enforce_rules(pdo)

    def reset(self) -> None:
        """Discard pending data and deadlines, as when the node leaves OPERATIONAL."""
        for pdo in self._all:
            pdo.layout, pdo.pending, pdo.received_ns, pdo.missed = None, None, None, False
            pdo.syncs, pdo.sent_ns, pdo.sent_data = 0, _NEVER_SENT, None

    @property
    def is_late(self) -> bool:
        """Whether an RPDO has missed its deadline and has not arrived since."""
        return any(pdo.missed for pdo in self._all)

    def receive(self, frame: Frame, now_ns: int) -> bool:
        """Process a frame that may be an RPDO; return False if it is an RPDO but too short."""
        for pdo in self._all:
            if pdo.receive and self._value(pdo.communication, 1) == frame.can_id:
                layout = self._layout(pdo)
                if len(frame.data) < layout.length:
                    return False
                pdo.received_ns, pdo.missed = now_ns, False
                data = frame.data[: layout.length]
                if self._value(pdo.communication, 2) <= 240:
                    pdo.pending = data
                else:
                    self._apply(layout, data)
        return True

    def sync(self, now_ns: int) -> None:
        """Apply the RPDOs received since the last SYNC, then send the TPDOs that are due."""
        for pdo in self._all:
            if pdo.receive:
                if pdo.pending is not None:
                    self._apply(self._layout(pdo), pdo.pending)
                    pdo.pending = None
            elif self._enabled(pdo) and 1 <= (every := self._value(pdo.communication, 2)) <= 240:
                pdo.syncs += 1
                if pdo.syncs >= every:
                    pdo.syncs = 0
                    self._transmit(pdo, now_ns)

    def poll(self, now_ns: int) -> bool:
        """Send event-driven TPDOs that are due; return whether an RPDO has just missed its deadline."""
        missed = False
        for pdo in self._all:
            timer_ns = self._value(pdo.communication, 5) * MS
            if pdo.receive:
                late = pdo.received_ns is not None and 0 < timer_ns <= now_ns - pdo.received_ns
                missed |= late and not pdo.missed
                pdo.missed |= late
            elif self._enabled(pdo) and self._value(pdo.communication, 2) >= 254:
                elapsed_ns = now_ns - pdo.sent_ns
                if elapsed_ns < self._value(pdo.communication, 3) * MS // 10:
                    continue  # inhibit time, in units of 0.1 ms
                if (0 < timer_ns <= elapsed_ns) or self._read(self._layout(pdo)) != pdo.sent_data:
                    self._transmit(pdo, now_ns)
        return missed

    def _value(self, index: int, sub: int) -> int:
        return self._dictionary.values.get((index, sub), 0)  # inhibit time and timer are optional

    def _enabled(self, pdo: _Pdo) -> bool:
        return not self._value(pdo.communication, 1) & COB_DISABLED

    def _layout(self, pdo: _Pdo) -> PdoLayout:
        if pdo.layout is None:
            objects, entries = self._mapped(pdo, self._value(pdo.mapping, 0)), self._dictionary.entries
            pdo.layout = PdoLayout(
                tuple(replace(o, is_signed=entries[o.index, o.sub].is_signed) for o in objects)
            )
        return pdo.layout

    def _mapped(self, pdo: _Pdo, count: int) -> list[Mapped]:
        return [Mapped.from_entry(self._value(pdo.mapping, n)) for n in range(1, count + 1)]

    def _read(self, layout: PdoLayout) -> bytes:
        return layout.pack(tuple(self._dictionary.get(o.index, o.sub) for o in layout.objects))

    def _transmit(self, pdo: _Pdo, now_ns: int) -> None:
        pdo.sent_data, pdo.sent_ns = self._read(self._layout(pdo)), now_ns
        self._send(Frame(self._value(pdo.communication, 1) & 0x7FF, pdo.sent_data))

    def _apply(self, layout: PdoLayout, data: bytes) -> None:
        for mapped, value in zip(layout.objects, layout.unpack(data), strict=True):
            with contextlib.suppress(Refused):  # a node cannot refuse a PDO
                self._dictionary.put(mapped.index, mapped.sub, value)

    def _enforce_rules(self, pdo: _Pdo) -> None:
        """CiA 301: disable the COB-ID, set the count to 0, write the entries, set the count, enable."""
        writes = self._dictionary.on_write

        def cob_id(value: int) -> None:
            if self._enabled(pdo) and not value & COB_DISABLED and value != self._value(pdo.communication, 1):
                raise Refused(SdoAbort.DEVICE_STATE)
            pdo.pending, pdo.received_ns, pdo.missed = None, None, False

        def transmission_type(value: int) -> None:
            if 240 < value < 254:
                raise Refused(SdoAbort.TOO_HIGH)

        def count(value: int) -> None:
            if self._enabled(pdo):
                raise Refused(SdoAbort.DEVICE_STATE)
            pdo.layout = None
            entries = self._mapped(pdo, value)
            for mapped in entries:
                self._check_mappable(pdo, mapped)
            if sum(mapped.bits for mapped in entries) > 64:
                raise Refused(SdoAbort.PDO_TOO_LONG)

        def entry(value: int) -> None:
            if self._enabled(pdo) or self._value(pdo.mapping, 0):
                raise Refused(SdoAbort.DEVICE_STATE)
            self._check_mappable(pdo, Mapped.from_entry(value))

        writes[pdo.communication, 1] = cob_id
        writes[pdo.communication, 2] = transmission_type
        writes[pdo.mapping, 0] = count
        for n in range(1, 9):
            writes[pdo.mapping, n] = entry

    def _check_mappable(self, pdo: _Pdo, mapped: Mapped) -> None:
        known = self._dictionary.entries.get((mapped.index, mapped.sub))
        if known is None:
            raise Refused(SdoAbort.NO_OBJECT)
        right_way = known.writable if pdo.receive else known.readable
        if not (known.mappable and right_way and known.bits == mapped.bits):
            raise Refused(SdoAbort.NOT_MAPPABLE)
