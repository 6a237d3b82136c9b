"""Faults of a CAN bus and of the devices on it, as far as they are CANopen's own."""

from __future__ import annotations

from collections.abc import Callable

from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.cia408 import State
from soro_core.hardware.canopen.frames import EmcyCode, SdoAbort
from soro_core.hardware.emulation.faults import Faults, Injection
from soro_core.hardware.emulation.line_faults import ON_BYTES
from soro_core.hardware.emulation.node import EmulatedNode
from soro_core.hardware.transport.frame import Frame

ON_ADAPTER_LINE = frozenset({"truncate", "garbage_line"})
ON_FRAMES = ON_BYTES - ON_ADAPTER_LINE | {"bus_off", "ack_missing", "babble"}
OF_NODES = frozenset(
    {"reboot", "brownout", "mute", "freeze_tpdo", "wrong_node_id", "sdo_abort", "sdo_timeout"}
)
_TPDO_FIRST, _TPDO_LAST = frames.TPDO_BASES[0], frames.TPDO_BASES[-1] + 0x7F


class NodeFaults:
    """What faults do to the frames of one node, on their way out and in, and to the node itself.

    Parameters
    ----------
    faults : callable
        Gives what is active.
    chambers : tuple of str
        Chambers that the node feeds: a fault of any of them is one of the node.
    now_ns : callable
        Time of the emulated world.
    """

    def __init__(
        self, faults: Callable[[], Faults], chambers: tuple[str, ...], now_ns: Callable[[], int]
    ) -> None:
        self._faults, self._chambers, self._now_ns = faults, chambers, now_ns
        self._sent: dict[int, bytes] = {}
        self._powered = True

    def outgoing(self, frame: Frame) -> Frame | None:
        """What the bus sees of a frame of the node."""
        if not self._faults().is_active:
            self._remember(frame)
            return frame
        if not self._powered or self._value("mute") is not None:
            return None
        is_reply = frame.can_id & ~0x7F == frames.SDO_RESPONSE
        if is_reply and self._value("sdo_timeout") is not None:
            return None
        if is_reply and self._value("sdo_abort") is not None:
            frame = Frame(
                frame.can_id, b"\x80" + frame.data[1:4] + SdoAbort.DEVICE_STATE.to_bytes(4, "little")
            )
        if self._value("freeze_tpdo") is not None and frame.can_id in self._sent:
            frame = Frame(frame.can_id, self._sent[frame.can_id])
        self._remember(frame)
        node = self._value("wrong_node_id")
        return frame if node is None else frame._replace(can_id=frame.can_id & ~0x7F | int(node))

    def incoming(self, frame: Frame) -> Frame | None:
        """What the node sees of a frame of the bus: under another address its own frames are not for it."""
        if not self._powered:
            return None
        node = self._value("wrong_node_id") if self._faults().is_active else None
        if node is None or frame.can_id & 0x7F == 0 or frame.can_id >= frames.HEARTBEAT_BASE:
            return frame
        own = frame.can_id & 0x7F == int(node)
        return None if not own else frame._replace(can_id=frame.can_id & ~0x7F | self._node_id)

    def attach(self, node: EmulatedNode) -> None:
        """Name the node whose frames these are."""
        self._node, self._node_id = node, node.node

    def begin(self, injection: Injection) -> None:
        """Do what happens to the node at the moment at which a fault begins."""
        if injection.chamber not in self._chambers:
            return
        if injection.fault == "reboot":
            self._node.reset(self._now_ns())
        elif injection.fault == "brownout":  # reported while there is enough power left for it
            self._node.fault(EmcyCode.SUPPLY_LOW, 1, State.FAULT_DISABLED)
            self._powered = False

    def end(self, injection: Injection) -> None:
        """Do what happens at its end."""
        if injection.chamber in self._chambers and injection.fault == "brownout":
            self._powered = True
            self._node.reset(self._now_ns())

    def _remember(self, frame: Frame) -> None:
        if _TPDO_FIRST <= frame.can_id <= _TPDO_LAST:
            self._sent[frame.can_id] = frame.data

    def _value(self, fault: str) -> float | None:
        faults = self._faults()
        return next((v for c in self._chambers if (v := faults.value(fault, c)) is not None), None)
