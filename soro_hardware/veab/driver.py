"""Driver for the published TCP server of the VEAB boards, and the thread that keeps the server running.

The server has no watchdog, and when it ends, the valves keep their pressure. It ends when its client
disconnects, after 0.5 s without a message, and at any message of another length. So the driver sends nothing
until readings have shown the server's number of ports, and each message in one piece. It does not disconnect
before readings have shown the arm empty. A thread sends 0 Pa while the control loop pauses. A supervisor
process shares the connection and vents when the driver is killed. For faults of the cable or the machine,
the arm needs a normally open dump valve.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import HardwareError
from soro_hardware.finding import Finding
from soro_hardware.link_driver import LinkDriver
from soro_hardware.supervisor_client import VentPlan
from soro_hardware.transport.tcp import ByteLink
from soro_hardware.veab import protocol
from soro_hardware.veab.config import VeabPlatform
from soro_hardware.veab.stream import MessageStream


class Keeper:
    """Calls `keep` periodically until `stop`.

    Parameters
    ----------
    keep : callable
        Function to call; it must not block.
    period_s : float
        Pause between two calls [s].
    """

    def __init__(self, keep: Callable[[], None], period_s: float) -> None:
        self._keep, self._period_s = keep, period_s
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="veab keeper", daemon=True)
        self._thread.start()

    @property
    def is_alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stopped.wait(self._period_s):
            self._keep()


# A message reaches the DACs in the server's next round, after 4 ms; then the connection may be closed.
_SETTLE_NS = 10_000_000
_LEAST_S = 0.05  # shortest time at 0 Pa before the end: readings may be older than the set points
_COUNT_S = 3.0  # longest time until the number of ports is known, also on a busy machine
# For the supervisor: longest wait for one reading, and for all.
_ANSWER_S, _LONGEST_S = 0.02, 10.0


class VeabRegulator(LinkDriver[VeabPlatform]):
    """Regulators of one arm behind the published server.

    Parameters
    ----------
    platform : VeabPlatform
        Ports, range and times.
    link : ByteLink
        Connection to the server; `configure` opens it.
    clock, lockstep : callable, bool
        As in `Driver`; in lockstep each message has one reading as answer, and no thread runs.
    """

    source, kind = "link", "VEAB server"
    device_watchdog = False

    def __init__(
        self, platform: VeabPlatform, link: ByteLink, clock: Callable[[], float], lockstep: bool = False
    ) -> None:
        super().__init__(platform, platform.host, link, clock, lockstep)
        self.empty_pa = platform.host.vented_pa
        self.rest_s = _LEAST_S, platform.host.vent_timeout_s
        self._stream = self.traffic = MessageStream(platform, link, clock, lockstep)
        self._keeper: Keeper | None = None
        self._broken_ns: int | None = None  # start of invalid readings
        self._is_new = False  # whether the driver has not waited for a reading yet
        self._zeros: Array = np.zeros(self.n_chambers)

    def probe(self) -> Iterator[Finding]:
        # The server ends when a client disconnects, so only the start-up connects to it.
        found = "the server ends when its client disconnects, also after this check"
        yield Finding(
            "published server",
            "warn",
            found,
            "start the server again afterwards; the server of soro_board does not end",
        )

    def start_up(self) -> None:
        stream, self._broken_ns = self._stream, None
        self.supervise()
        if self.link.is_open and not stream.broken:
            with contextlib.suppress(HardwareError):  # the connection may be lost
                stream.drain()
        # The server ends when its client disconnects, so keep a connection that works.
        is_new = not self.link.is_open or stream.broken is not None
        if is_new:
            self.link.open()
            self.connected()
            self._is_new = False
        else:
            self.share()
        if self._keeper is None and not self.lockstep:
            self._keeper = Keeper(self._keep, self.platform.host.keep_alive_s / 4)
        self._bring_to_zero(is_new)

    def connected(self) -> None:
        self._stream.begin()
        self._broken_ns, self._is_new = None, True
        self.share()

    def send_and_receive(self, setpoint_pa: Array) -> bool:
        stream = self._stream
        if self._keeper is not None and not self._keeper.is_alive:
            self.latch.add("device_error", self.source, "the thread that keeps the server alive has died")
            setpoint_pa = self._zeros
        if self._is_new:  # a reading shows how many ports the server has, before any message
            self._wait_for_reading()
            stream.take_new()
            self._is_new = False
        if not self.lockstep:
            stream.drain()
        self._send(setpoint_pa)
        self._wait_for_reading()
        if stream.broken:
            self._resynchronise(stream.broken)
        if stream.count.fits is False:
            self.latch.add("out_of_sync", self.source, str(stream.count))
        self.pressure_pa, new = stream.pressure_pa, stream.take_new()
        self.answers_lost += not new
        return new and stream.count.fits is True

    def post_zeros(self) -> None:
        self._stream.drain()
        self._send(self._zeros)

    def wait(self, duration_s: float) -> None:
        if not self.link.is_open:
            raise HardwareError("the connection is gone")
        self._stream.receive(duration_s)

    def silence(self, duration_s: float) -> None:
        super().silence(duration_s)
        self._send(self._zeros)  # the server ends after 0.5 s without a message

    def after_test(self) -> None:
        self._stream.skip()

    def begin_end(self) -> None:
        keeper, self._keeper = self._keeper, None  # the ramp to 0 Pa does without it
        if keeper is not None:
            keeper.stop()

    def vent_plan(self) -> VentPlan:
        ports, vented_pa = self.platform.ports, self.platform.host.vented_pa
        step = {
            "send": protocol.encode([0.0] * ports).decode("latin-1"),
            "doubles": ports,
            "low": protocol.volts(-vented_pa),
            "high": protocol.volts(vented_pa),
        }
        return VentPlan(self.kind, (step,), _ANSWER_S, _LONGEST_S, least_s=_LEAST_S)

    # -- a cycle -----------------------------------------------------------------------------------

    def _send(self, setpoint_pa: Array) -> None:
        self.sent_pa = setpoint_pa.copy()
        if not self._stream.send(setpoint_pa):
            self.sent_pa = self._zeros.copy()

    def _wait_for_reading(self) -> None:
        stream = self._stream
        deadline = self.clock() + self.patience_s(self.platform.cycle_budget_s)
        while not stream.has_new and not stream.broken and (left := deadline - self.clock()) > 0:
            if not self._stream.receive(left):
                return

    def _resynchronise(self, why: str) -> None:
        """Close a connection with invalid readings, after the server has had time to write 0 Pa."""
        self.latch.add("out_of_sync", self.source, f"the server sends {why}")
        if self._broken_ns is None:
            self._broken_ns = self._now_ns
            self._stream.garbled += 1
            self._send(self._zeros)
        elif self._now_ns - self._broken_ns >= _SETTLE_NS:
            self.give_up()

    def _keep(self) -> None:
        """Work of the keeper: receive the readings, and send 0 Pa if the control loop pauses."""
        stream = self._stream
        with self._lock:
            if not self.link.is_open:
                return
            try:
                stream.drain()
                silent_s = self.clock() - stream.sent_s
                if silent_s >= self.platform.host.keep_alive_s:
                    if self.sent_pa.any():
                        text = f"no exchange for {silent_s * 1e3:.0f} ms"
                        self.latch.add("watchdog_vented", "host", text)
                    self._send(self._zeros)
                    self._watched(self.sent_pa)
            except HardwareError as error:
                self.on_lost(error)

    # -- start-up ----------------------------------------------------------------------------------

    def _bring_to_zero(self, is_new: bool) -> None:
        """Send 0 Pa until the readings show that every chamber is empty."""
        times, stream = self.platform.host, self._stream
        # In lockstep each message advances the devices by one cycle, so send only the necessary ones.
        has_read = self.lockstep and (not is_new or self._stream.receive(self.platform.lockstep_timeout_s))
        self._count_ports()
        self.pressure_pa = stream.pressure_pa
        if has_read and not self.sent_pa.any() and np.all(np.abs(self.pressure_pa) < self.empty_pa):
            stream.take_new()
            self.seen_empty = True
            return
        for _ in range(round(times.vent_timeout_s * self.platform.cycle_hz)):
            self.paced(self._zeros)
            self._require_stream()
            if self.seen_empty:
                return
        if not stream.count.fits:  # in lockstep: without a first reading
            raise self._miscounted()
        n = int(np.argmax(np.abs(self.pressure_pa)))
        kept = f"{self.pressure_pa[n] / 1e3:.1f} kPa after {times.vent_timeout_s:g} s of set point 0"
        which = f"{self._names[n]} (port {self.platform.valves[n].port})"
        text = f"{kept}; look at that valve, its sensor and its wires"
        raise HardwareError(text, which, "pressure", "start-up")

    def _count_ports(self) -> None:
        """Close the connection to a server with another number of ports; the server vents by itself."""
        stream = self._stream
        for _ in range(0 if self.lockstep else round(_COUNT_S * self.platform.cycle_hz)):
            if stream.count.fits is not None:
                break
            self.paced(self._zeros)
            self._require_stream()
        if not stream.count.fits and not (self.lockstep and stream.count.may_send):
            self.give_up()
            raise self._miscounted()

    def _miscounted(self) -> HardwareError:
        code = "silent" if self._stream.count.fits is None else "refused"
        return HardwareError(str(self._stream.count), code=code, step="start-up")

    def _require_stream(self) -> None:
        if not self.link.is_open or self._stream.broken:
            # Readings that became invalid in a pause are not latched yet.
            why = self.latched[0].message if self.latched else f"the server sends {self._stream.broken}"
            advice = "is `ports` what the server has, and was it started again after its last client?"
            raise HardwareError(f"{why}; {advice}", code="gone", step="start-up")


open_driver = VeabRegulator.over_tcp
