"""The emulated platform without a process around it: bus, nodes and air, with the time given from outside."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soro_core.hardware.canopen.cia408 import CYCLE_PERIOD
from soro_core.hardware.canopen.frames import SYNC_ID
from soro_core.hardware.emulation.air import Air
from soro_core.hardware.emulation.hub import Hub, Port
from soro_core.hardware.emulation.node import EmulatedNode
from soro_core.hardware.platform import Platform
from soro_core.hardware.port import Array
from soro_core.hardware.transport.frame import Frame

LONGEST_STEP_NS = 20_000_000


class World:
    """Emulated devices of one platform.

    In lockstep frames take no time, and each SYNC of the host, once the devices have answered it, advances
    everything by the communication cycle period that the host has written (object 1006). In real time `run`
    advances to the time that it is given.

    Parameters
    ----------
    platform : Platform
        What is emulated.
    receive : callable
        Takes every frame that the host's adapter hears.
    lockstep : bool
        Whether SYNC is the clock.
    seed : int
        Seed of the sensor noise.
    """

    def __init__(
        self, platform: Platform, receive: Callable[[Frame], None], lockstep: bool, seed: int = 0
    ) -> None:
        emulation = platform.emulation
        self.now_ns = 0
        self.ticks = 0
        self.stalled_ns = 0
        self.on_tick: Callable[[int, Array], None] = lambda time_ns, pressures: None
        self._lockstep = lockstep
        self._default_period_ns = round(1e9 / platform.cycle_hz)
        self._step_ns = round(emulation.step_s * 1e9)
        self._next_step_ns = self._step_ns
        self.hub = Hub(0 if lockstep else platform.transport.bitrate)
        self._host = self.hub.attach(lambda frame, _: receive(frame))
        delay_ns = 0 if lockstep else round(emulation.boot_delay_s * 1e9)
        self.nodes = [self._attach(valve.node, platform, delay_ns) for valve in platform.valves]
        demands = [node.valve.demand_pa for node in self.nodes]
        self.air = Air(emulation.regulator, demands, np.random.default_rng(seed))
        for number, node in enumerate(self.nodes):
            node.valve.connect(self.air, number)
            node.poll(0)
        self.hub.run(0)

    @property
    def pressure_pa(self) -> Array:
        """True chamber pressures [Pa gauge]."""
        return self.air.pressure_pa

    @property
    def next_event_ns(self) -> int:
        """Time at which `run` has something to do, in real time."""
        event = self.hub.next_event_ns
        return self._next_step_ns if event is None else min(event, self._next_step_ns)

    def host_sends(self, frame: Frame) -> None:
        """Take a frame from the host's adapter."""
        self.hub.send(self._host, frame, self.now_ns)
        self.hub.run(self.now_ns)
        if self._lockstep and frame.can_id == SYNC_ID and not frame.extended:
            self._tick(self.now_ns + self._period_ns())

    def run(self, now_ns: int) -> int:
        """Advance to a time, in real time; return how far the world stays behind it [ns].

        A world whose process was held up does not catch up with more than 20 ms: its devices would miss
        heartbeats that are only waiting to be read, which real devices do not.
        """
        behind = max(now_ns - self.now_ns - LONGEST_STEP_NS, 0)
        self.stalled_ns += behind
        target = now_ns - behind
        while self.next_event_ns <= target:
            self.now_ns = max(self.next_event_ns, self.now_ns)
            self.hub.run(self.now_ns)
            if self.now_ns >= self._next_step_ns:
                self._next_step_ns += self._step_ns
                self._tick(self.now_ns)
        self.now_ns = max(target, self.now_ns)
        self.hub.run(self.now_ns)
        return behind

    def _tick(self, now_ns: int) -> None:
        self.now_ns = now_ns
        self.ticks += 1
        self.air.advance(now_ns)
        for node in self.nodes:
            node.poll(now_ns)
        self.hub.run(now_ns)
        self.on_tick(now_ns, self.air.pressure_pa)

    def _period_ns(self) -> int:
        period_us = self.nodes[0].dictionary.values[CYCLE_PERIOD, 0]
        return period_us * 1000 if period_us else self._default_period_ns

    def _attach(self, node: int, platform: Platform, boot_delay_ns: int) -> EmulatedNode:
        port: Port

        def send(frame: Frame) -> None:
            self.hub.send(port, frame, self.now_ns)

        emulated = EmulatedNode(node, platform.emulation, send, boot_delay_ns)
        port = self.hub.attach(emulated.receive)
        return emulated
