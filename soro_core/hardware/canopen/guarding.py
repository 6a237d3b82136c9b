"""Node guarding (CiA 301): the host asks each node for its state, and a node that is not asked vents.

It is the older way, of devices without heartbeats. The host sends a remote frame; the node answers with its
state and a bit that changes with every answer. Both ends give up when nothing has come for the life time.
"""

from __future__ import annotations

from collections.abc import Sequence

from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.monitor import NodeMonitor
from soro_core.hardware.transport.frame import Frame


class Guarding:
    """Asks the nodes in turn, so that the answers do not all come in one cycle.

    Parameters
    ----------
    nodes : sequence of NodeMonitor
        Nodes to guard.
    period_s : float
        Guard time [s] of each.
    """

    def __init__(self, nodes: Sequence[NodeMonitor], period_s: float) -> None:
        self._period_ns = round(period_s * 1e9)
        self._shift_ns = {
            node.node: n * self._period_ns // len(nodes)
            for n, node in enumerate(nodes)
            if node.device.is_guarded
        }
        self._asked: dict[int, int] = {}

    def all(self) -> list[Frame]:
        """Ask every node."""
        return [frames.guard(node) for node in self._shift_ns]

    def due(self, now_ns: int) -> list[Frame]:
        """Ask those whose time has come."""
        found = []
        for node, shift_ns in self._shift_ns.items():
            turn = (now_ns - shift_ns) // self._period_ns
            if self._asked.setdefault(node, turn) != turn:
                self._asked[node] = turn
                found.append(frames.guard(node))
        return found
