"""From set points to the RPDOs of every node: counts, control words, and zeros."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.canopen.cia408 import Control
from soro_core.hardware.canopen.config import CanopenPlatform
from soro_core.hardware.canopen.mapping import FixedScaling
from soro_core.hardware.canopen.monitor import ChannelMonitor, NodeMonitor
from soro_core.hardware.port import Array
from soro_core.hardware.transport.frame import Frame


class Setpoints:
    """Builds what goes out in a cycle.

    Parameters
    ----------
    platform : CanopenPlatform
        Valves.
    nodes : sequence of NodeMonitor
        Their channels know scaling and state.

    Attributes
    ----------
    channels : list of ChannelMonitor
        In the order of every array.
    sent_pa : ndarray (n,)
        What the counts of the latest set points mean [Pa gauge].
    """

    def __init__(self, platform: CanopenPlatform, nodes: Sequence[NodeMonitor]) -> None:
        self._nodes = nodes
        self._places = [(valve.node, valve.channel) for valve in platform.valves]
        by_chamber = {channel.chamber: channel for node in nodes for channel in node.channels}
        self.channels = [by_chamber[name] for name in platform.chamber_names]
        fixed = platform.canopen.mapping.scaling
        # Before the start-up has read the scaling of a device; one that tells it has 0 Pa at 0.
        self._zero_count = fixed.setpoint.zero_count if isinstance(fixed, FixedScaling) else 0
        self._zero_rounds = 0  # rounds of zeros since the last set point
        self.sent_pa: Array = np.zeros(len(self.channels))

    def restart(self) -> None:
        """Nothing has been sent yet."""
        self._zero_rounds = 0
        self.sent_pa = np.zeros(len(self.channels))

    def frames(self, setpoint_pa: Array, control: Control) -> Callable[[bool], list[Frame]]:
        """RPDOs for set points; the argument says whether unchanged control words are sent again."""
        self._zero_rounds = 0
        counts = []
        sent = np.zeros(len(self.channels))
        for n, channel in enumerate(self.channels):
            if channel.scaling is None:
                raise HardwareError(f"{channel.source}: not configured")
            counts.append(channel.scaling.counts(setpoint_pa[n]))
            sent[n] = channel.scaling.sent_pa(counts[n])
        self.sent_pa = sent
        return lambda repeat: self._rpdos(lambda _: control, counts, repeat)

    def zeros(self, repeat: bool) -> list[Frame]:
        """Set point 0 for everyone: at first in ACTIVE where that is the state, from then on in HOLD."""
        first = self._zero_rounds == 0
        self._zero_rounds += 1
        self.sent_pa = np.zeros(len(self.channels))
        counts = [self._zero_count if c.scaling is None else c.scaling.setpoint_zero for c in self.channels]
        rpdos = self._rpdos(lambda c: Control.ACTIVE if first and c.active else Control.HOLD, counts, repeat)
        for channel in self.channels:
            channel.stand_down()
        return rpdos

    def supply_pa(self) -> Array:
        """Supply pressure [Pa gauge] of each channel's node, NaN before the first report."""
        supply_pa = {node.node: node.supply_pa for node in self._nodes}
        return np.array([supply_pa[node] for node, _ in self._places])

    def _rpdos(
        self, control: Callable[[ChannelMonitor], Control], counts: Sequence[int], repeat: bool
    ) -> list[Frame]:
        controls: dict[int, dict[int, Control]] = {node.node: {} for node in self._nodes}
        setpoints: dict[int, dict[int, int]] = {node.node: {} for node in self._nodes}
        for (node, number), channel, count in zip(self._places, self.channels, counts, strict=True):
            controls[node][number] = control(channel)
            setpoints[node][number] = count
        return [f for n in self._nodes for f in n.rpdos(controls[n.node], setpoints[n.node], repeat)]
