"""From received frames to the records of the nodes that sent them."""

from __future__ import annotations

from collections.abc import Sequence

from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.device import Device
from soro_core.hardware.canopen.monitor import NodeMonitor
from soro_core.hardware.transport.frame import Frame


class Dispatch:
    """Knows by identifier whose frame it is; frames of nobody are passed over."""

    def __init__(self, nodes: Sequence[NodeMonitor], device: Device) -> None:
        self._tpdos = {pdo.cob_id(node.node): (node, pdo) for node in nodes for pdo in device.tpdos}
        self._heartbeats = {frames.HEARTBEAT_BASE + node.node: node for node in nodes}
        self._emergencies = {frames.EMCY_BASE + node.node: node for node in nodes}

    def take(self, frame: Frame, now_ns: int, in_cycle: bool) -> None:
        """Hand a frame on; `in_cycle` says that it came while the answers to a SYNC are awaited."""
        if frame.extended or frame.remote:
            return
        if answer := self._tpdos.get(frame.can_id):
            node, pdo = answer
            node.on_tpdo(pdo, frame.data, now_ns, in_cycle)
        elif found := self._heartbeats.get(frame.can_id):
            found.on_state(frame.data, now_ns)
        elif found := self._emergencies.get(frame.can_id):
            found.on_emergency(frame.data)
