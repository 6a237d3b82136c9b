"""Faults of a CAN bus and of CANopen nodes."""

from __future__ import annotations

from soro_hardware.canopen import frames, sdo_frames
from soro_hardware.canopen.cia408 import ValveState
from soro_hardware.canopen.frames import EmcyCode
from soro_hardware.canopen.sdo_frames import SdoAbort
from soro_hardware.emulation.canopen.node import EmulatedNode
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
    """Effects of faults on one node and on the frames that it sends and receives.

    Parameters
    ----------
    faults : FaultSchedule
        Active faults.
    chambers : tuple of str
        Chambers of the node: a device fault of any of them is a fault of the node.
    """

    def __init__(self, faults: FaultSchedule, chambers: tuple[str, ...]) -> None:
        self._faults, self._chambers = faults, chambers
        self._sent: dict[int, bytes] = {}
        self._powered = True

    def outgoing(self, frame: Frame) -> Frame | None:
        """Return the frame that reaches the bus when the node sends `frame`, or None."""
        if not self._faults.is_active:
            self._remember(frame)
            return frame
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
        self._remember(frame)
        node = self._value("wrong_node_id")
        return frame if node is None else frame._replace(can_id=frame.can_id & ~0x7F | int(node))

    def incoming(self, frame: Frame) -> Frame | None:
        """Return the frame that reaches the node from the bus, or None.

        A node with a wrong node id receives the frames of that id.
        """
        if not self._powered:
            return None
        node = self._value("wrong_node_id") if self._faults.is_active else None
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

    def _remember(self, frame: Frame) -> None:
        if _TPDO_FIRST <= frame.can_id <= _TPDO_LAST:
            self._sent[frame.can_id] = frame.data

    def _value(self, fault: str) -> float | None:
        found = (self._faults.value(fault, chamber) for chamber in self._chambers)
        return next((value for value in found if value is not None), None)
