"""The regulator port: the interface of all families of pressure regulators.

A program that drives an arm uses only `Regulator`. One `exchange` in each control period sends the set points
and returns the pressures. Faults are returned as values (`Fault`), so that the caller decides in one place
how to make the arm safe. Only a lost connection (adapter unplugged) or a wrong call raises an error.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array, Flags
from soro_hardware.finding import Finding

EMPTY_PA = 2e3  # pressure below which a chamber counts as empty


@dataclass(frozen=True)
class Fault:
    """A fault of a device or a bus.

    Attributes
    ----------
    code : str
        One of `FAULT_CODES`.
    source : str
        Device or bus, for example ``link0/chamber1 (node 2)`` or ``bus``.
    message : str
        Description in one line.
    latched : bool
        True if the fault stays until the next `Regulator.configure`; until then the driver sends zeros.
    """

    code: str
    source: str
    message: str
    latched: bool = False


FAULT_CODES = {
    "emergency": "the device sent an emergency message",
    "rebooted": "the device has restarted and lost its configuration",
    "heartbeat_lost": "the device has sent no heartbeat for the consumer heartbeat time",
    "guard_lost": "the device has not answered node guarding for its life time",
    "left_operational": "the device left the communication state in which it exchanges values",
    "not_active": "the device does not follow the set point of the bus",
    "stale_reading": "no pressure has arrived for several cycles",
    "bus_off": "the CAN controller of the adapter is in the state bus-off",
    "connection_lost": "the connection to the adapter was lost; it is open again and needs configure",
    "device_silent": "the device has not answered several requests in a row",
    "setpoint_ignored": "the device has confirmed or keeps a set point that differs from the sent one",
    "command_rejected": "the device has refused a required command",
    "sensor_failed": "the device reports that it cannot measure its pressure",
    "supervisor_lost": "the process that vents when the driver dies has ended, stands still, or has vented",
    "link_lost": "the connection to the device is lost",
    "out_of_sync": "the byte stream of the device was invalid, so the driver connected again",
    "watchdog_vented": "a watchdog has vented because no set point arrived in time",
    "stop_pressed": "the emergency stop is pressed, or the wire of its contact is broken",
    "over_temperature": "the device reports a temperature above its limit",
    "device_error": "the device reports an error",
    "refused_setpoint": "a set point of the caller is not finite or out of range",
}


@dataclass(frozen=True)
class Exchange:
    """Result of one cycle.

    Attributes
    ----------
    sent_pa : ndarray (n,)
        Sent set points [Pa gauge], after rounding to the resolution of the device.
    pressure_pa : ndarray (n,)
        Newest measured pressures [Pa gauge]; NaN for a chamber without a reading.
    fresh : ndarray (n,) of bool
        Whether the pressure was sampled in this cycle.
    faults : tuple of Fault
        Present faults; empty in a healthy cycle.
    supply_pa : ndarray (n,) or None
        Supply pressures [Pa gauge], NaN for a chamber whose device reports none; None if no device does.
    """

    sent_pa: Array
    pressure_pa: Array
    fresh: Flags
    faults: tuple[Fault, ...] = ()
    supply_pa: Array | None = None

    @property
    def fault_text(self) -> str | None:
        """All faults in one line, or None."""
        return "; ".join(f"{f.code}: {f.source}: {f.message}" for f in self.faults) or None

    @property
    def known_pa(self) -> Array:
        """Readings (n,) [Pa gauge] for the limiter: 0 for a chamber without a reading.

        The limiter trips such a chamber by the age of its reading.
        """
        return np.where(self.fresh | np.isfinite(self.pressure_pa), self.pressure_pa, 0.0)


@dataclass(frozen=True)
class BusStatistics:
    """Counts since the driver was made.

    Attributes
    ----------
    cycles : int
        Number of exchanges.
    frames_sent, frames_received : int
        Number of frames or messages sent and received.
    frames_lost : int
        Answers that had not arrived at the end of their cycle.
    frames_late : int
        Lost answers that arrived later.
    frames_garbled : int
        Malformed lines or frames, which were dropped.
    frames_refused : int
        Frames that the adapter or the device refused.
    emergencies : int
        Received emergency messages with an error code other than 0.
    bus_errors : int
        Errors on the bus that the adapter reported.
    """

    cycles: int = 0
    frames_sent: int = 0
    frames_received: int = 0
    frames_lost: int = 0
    frames_late: int = 0
    frames_garbled: int = 0
    frames_refused: int = 0
    emergencies: int = 0
    bus_errors: int = 0


class Regulator(ABC):
    """Pressure regulators of one arm behind one bus.

    The calls are: the constructor (opens nothing), `configure` (blocking), `exchange` once in each control
    period, `close`. `vent` is allowed between any of them. The class is not thread safe.

    Attributes
    ----------
    device_watchdog : bool
        Whether the devices vent by themselves when messages of the host stop. Without such a watchdog, the
        arm needs a supervisor process and a normally open dump valve.
    """

    device_watchdog: bool

    @property
    @abstractmethod
    def chamber_names(self) -> tuple[str, ...]:
        """Names of the chambers, in the order of every array."""

    @property
    def n_chambers(self) -> int:
        """Number of chambers."""
        return len(self.chamber_names)

    @property
    @abstractmethod
    def update_hz(self) -> float:
        """Rate [Hz] of the set points and readings of one chamber without disturbances.

        `exchange` may be called more often; `Exchange.fresh` states which chambers a call has sampled.
        """

    @property
    def reading_age_s(self) -> float:
        """Age [s] of a reading up to which this bus does not count it as lost; the limits allow for it.

        Four updates, unless the timeouts of the family are longer.
        """
        return 4.0 / self.update_hz

    @property
    @abstractmethod
    def statistics(self) -> BusStatistics:
        """Counts since the driver was made."""

    def probe(self) -> Iterable[Finding]:
        """Check the hardware before `configure`, for `soro doctor`; sends no commands."""
        return ()

    @abstractmethod
    def configure(self) -> None:
        """Open the bus, check and configure every device, and bring it to a set point of 0 Pa.

        The call blocks. A second call clears latched faults by a new start-up. Afterwards the devices stay
        safe for any time: the first `exchange` arms their watchdogs.

        Raises
        ------
        HardwareError
            If a step fails; the message states the device and the step.
        """

    @abstractmethod
    def exchange(self, setpoint_pa: Array, now_ns: int) -> Exchange:
        """Send one set point to each chamber and return the pressures, in bounded time.

        Parameters
        ----------
        setpoint_pa : ndarray (n,)
            Set points [Pa gauge] from the limiter. If one is not finite or out of range, the driver reports a
            fault and sends zeros to all chambers.
        now_ns : int
            Time of this cycle [ns], which never decreases; heartbeats and time limits use it.

        Raises
        ------
        HardwareError
            If the connection to the bus is lost, before `configure`, or for a wrong shape.
        """

    @abstractmethod
    def vent(self) -> None:
        """Command 0 Pa for every chamber at once, without slew; idempotent, from any state, never raises.

        The driver sends nothing before the first `configure`, when the devices are safe by themselves, and
        while the connection is lost. Devices with a watchdog then vent by themselves. For devices without
        one, each call also tries to restore the connection, even after a failed start-up.
        """

    @abstractmethod
    def close(self) -> None:
        """Ramp the pressures down, stop the devices and close the bus; idempotent, never raises."""
