"""Watches of an emulated node for messages of its host: heartbeat, node guarding, SYNC.

After CANopenNode 4 (301/CO_HBconsumer.c, CO_Node_Guarding.c, CO_SYNC.c): each watch starts with the first
message of its kind, and an error lasts until the next message of that kind. No watch is active in STOPPED.
"""

from __future__ import annotations

from soro_hardware.canopen.cia408 import (
    CONSUMER_HEARTBEAT,
    CYCLE_PERIOD,
    GUARD_TIME,
    LIFE_TIME_FACTOR,
)
from soro_hardware.canopen.frames import EmcyCode, NmtState
from soro_hardware.emulation.canopen.dictionary import ObjectDictionary

_US, _MS = 1_000, 1_000_000


class Watches:
    """Watches of one node.

    Parameters
    ----------
    dictionary : ObjectDictionary
        Objects 1006, 100C, 100D and 1016 configure the watches; a write restarts a watch.

    Attributes
    ----------
    errors : set of EmcyCode
        Present errors: HEARTBEAT_LOST (also for node guarding), COMMUNICATION (a late SYNC).
    """

    def __init__(self, dictionary: ObjectDictionary) -> None:
        self._values = dictionary.values
        self.errors: set[EmcyCode] = set()
        # Times of the last message of each kind; None: the next message starts the watch.
        self._heartbeat_ns: int | None = None
        self._guarded_ns: int | None = None
        self._sync_ns: int | None = None
        dictionary.on_write[CONSUMER_HEARTBEAT, 1] = self._on_consumer
        for key in ((GUARD_TIME, 0), (LIFE_TIME_FACTOR, 0)):
            dictionary.on_write[key] = self._on_guard_time

    def reset(self) -> None:
        """Stop all watches and clear the errors, as a reset of the communication does."""
        self.errors.clear()
        self._heartbeat_ns = self._guarded_ns = self._sync_ns = None

    def heartbeat(self, node: int, state: int, now_ns: int) -> None:
        """Process a heartbeat; after a boot-up message the watched node is lost until its next heartbeat.

        Parameters
        ----------
        node : int
            Node id of the sender.
        state : int
            NMT state of the sender.
        now_ns : int
            Present time [ns].
        """
        consumed, limit_ns = self._consumed()
        if node != consumed or not limit_ns:
            return
        if state != NmtState.BOOT_UP:
            self._heartbeat_ns = now_ns
            self.errors.discard(EmcyCode.HEARTBEAT_LOST)
        elif self._heartbeat_ns is not None:
            self._heartbeat_ns = None
            self.errors.add(EmcyCode.HEARTBEAT_LOST)

    def guarded(self, now_ns: int) -> None:
        """Process a node guarding request."""
        self._guarded_ns = now_ns if self._life_ns() else None
        self.errors.discard(EmcyCode.HEARTBEAT_LOST)

    def sync(self, now_ns: int) -> None:
        """Process a SYNC."""
        self._sync_ns = now_ns
        self.errors.discard(EmcyCode.COMMUNICATION)

    def poll(self, now_ns: int, stopped: bool) -> None:
        """Add an error for each message that has not arrived in time."""
        if stopped:
            self._heartbeat_ns = self._guarded_ns = None
            self._sync_ns = None if self._sync_ns is None else now_ns
            return
        if _is_over(self._heartbeat_ns, self._consumed()[1], now_ns):
            self._heartbeat_ns = None
            self.errors.add(EmcyCode.HEARTBEAT_LOST)
        if _is_over(self._guarded_ns, self._life_ns(), now_ns):
            self._guarded_ns = None
            self.errors.add(EmcyCode.HEARTBEAT_LOST)
        period_ns = self._values.get((CYCLE_PERIOD, 0), 0) * _US
        if self._sync_ns is not None and 0 < 3 * period_ns < 2 * (now_ns - self._sync_ns):
            self.errors.add(EmcyCode.COMMUNICATION)

    def _consumed(self) -> tuple[int, int]:
        """Return the watched node, and the longest time [ns] between its heartbeats."""
        value = self._values.get((CONSUMER_HEARTBEAT, 1), 0)
        return value >> 16 & 0x7F, (value & 0xFFFF) * _MS

    def _on_consumer(self, value: int) -> None:
        self._heartbeat_ns = None
        if not value & 0xFFFF:  # the watch is disabled
            self.errors.discard(EmcyCode.HEARTBEAT_LOST)

    def _life_ns(self) -> int:
        """Return the time [ns] without a request after which the host is lost; 0 for no watch."""
        return self._values.get((GUARD_TIME, 0), 0) * self._values.get((LIFE_TIME_FACTOR, 0), 0) * _MS

    def _on_guard_time(self, value: int) -> None:
        if not value:
            self._guarded_ns = None


def _is_over(since_ns: int | None, limit_ns: int, now_ns: int) -> bool:
    return since_ns is not None and 0 < limit_ns <= now_ns - since_ns
