"""The regulator port: what every family of pressure regulators does, whatever bus it hangs on.

A program that drives an arm sees only `Regulator`. One `exchange` a control period sends the set points and
brings back the pressures; what goes wrong comes back as a value (`Fault`), so that the caller decides in one
place how to make the arm safe. Only what ends the connection itself (adapter unplugged, wrong use) is raised.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.hardware.finding import Finding

Array: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True)
class Fault:
    """Something that a device or a bus did wrong.

    Attributes
    ----------
    code : str
        One of `FAULT_CODES`.
    source : str
        Who, for example ``link0/chamber1 (node 2)`` or ``bus``.
    message : str
        What, in one line.
    latched : bool
        True when it stays until `Regulator.configure` has run again: meanwhile the driver sends zeros only.
    """

    code: str
    source: str
    message: str
    latched: bool = False


FAULT_CODES = {
    "emergency": "the device sent an emergency message",
    "rebooted": "the device started anew and lost its configuration",
    "heartbeat_lost": "the device has not been heard for the consumer heartbeat time",
    "guard_lost": "the device has not answered node guarding for its life time",
    "left_operational": "the device left the communication state in which it exchanges values",
    "not_active": "the device does not follow the set point of the bus",
    "stale_reading": "no pressure has come for several cycles",
    "bus_off": "the controller of the adapter has taken itself off the bus",
    "connection_lost": "the connection to the adapter broke; it is open again and waits for configure",
    "device_silent": "the device has not answered several requests in a row",
    "setpoint_ignored": "the device has confirmed or keeps another set point than it was sent",
    "command_rejected": "the device has refused a command that it must know",
    "sensor_failed": "the device says that it cannot measure its pressure",
    "supervisor_lost": "the process that vents when the driver dies has ended",
    "link_lost": "the connection to the device has broken",
    "out_of_sync": "the device's stream of bytes made no sense, so the connection was made anew",
    "watchdog_vented": "a watchdog has vented because no set point came in time",
    "device_error": "the device reports an error of its own",
    "refused_setpoint": "the caller gave a set point that is not finite or out of range",
}


@dataclass(frozen=True)
class Exchange:
    """What one cycle did.

    Attributes
    ----------
    sent_pa : ndarray (n,)
        Set points [Pa gauge] as they went over the wire, after rounding to the device's resolution.
    pressure_pa : ndarray (n,)
        Newest measured pressures [Pa gauge]; NaN for a chamber that has never reported.
    fresh : ndarray (n,) of bool
        True where the pressure was sampled in this cycle.
    faults : tuple of Fault
        Everything that is wrong now; empty in a healthy cycle.
    supply_pa : ndarray (n,) or None
        Supply pressures [Pa gauge] where the devices report them (NaN for a chamber whose device does not).
    """

    sent_pa: Array
    pressure_pa: Array
    fresh: Flags
    faults: tuple[Fault, ...] = ()
    supply_pa: Array | None = None

    @property
    def trouble(self) -> str | None:
        """All faults in one line, or None."""
        return "; ".join(f"{f.code}: {f.source}: {f.message}" for f in self.faults) or None

    @property
    def known_pa(self) -> Array:
        """Readings (n,) [Pa gauge] to be judged: a chamber that has never reported is not known to be bad.

        Its silence trips by its age.
        """
        return np.where(self.fresh | np.isfinite(self.pressure_pa), self.pressure_pa, 0.0)


@dataclass(frozen=True)
class BusStatistics:
    """Counts since the driver was made.

    Attributes
    ----------
    cycles : int
        Exchanges made.
    frames_sent, frames_received : int
        CAN frames given to and taken from the adapter.
    frames_lost : int
        Answers that had not come when their cycle's time was over.
    frames_late : int
        Of these, answers that came afterwards.
    frames_garbled : int
        Lines or frames that were dropped because they were malformed.
    frames_refused : int
        Frames that the adapter refused to send.
    emergencies : int
        Emergency messages received, "all clear" not counted.
    bus_errors : int
        Errors on the wire that the adapter reported.
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

    Life: made (nothing is opened), `configure` (blocking), `exchange` once a control period, `close`.
    `vent` may be called between any two of them. Not thread safe: one thread owns it.

    Attributes
    ----------
    device_watchdog : bool
        Whether the devices vent by themselves when their host falls silent. Where they do not, the arm needs
        a supervisor process and a normally open dump valve.
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
        """Rate [Hz] at which a chamber gets set points and gives readings when all goes well.

        `exchange` may be called more often; `Exchange.fresh` says which chambers a call has sampled.
        """

    @property
    def reading_age_s(self) -> float:
        """Age [s] that a reading can have before this bus counts it as lost; the limits allow for it.

        Four updates, unless a family's own patience with its devices is longer.
        """
        return 4.0 / self.update_hz

    @property
    @abstractmethod
    def statistics(self) -> BusStatistics:
        """Counts since the driver was made."""

    def probe(self) -> Iterable[Finding]:
        """Look at the hardware before it is configured, for `soro doctor`; without commanding anything."""
        return ()

    @abstractmethod
    def configure(self) -> None:
        """Open the bus, check and configure every device, and bring it to where it holds 0 Pa.

        Blocking. Called again, it clears latched faults by running the whole start-up once more. After it the
        devices stay safe for any length of time: their watchdogs are armed by the first `exchange`.

        Raises
        ------
        HardwareError
            One line that names the device and the step.
        """

    @abstractmethod
    def exchange(self, setpoint_pa: Array, now_ns: int) -> Exchange:
        """Send one set point a chamber and bring back the pressures; bounded in time.

        Parameters
        ----------
        setpoint_pa : ndarray (n,)
            Set points [Pa gauge]. The limiter stands before the driver: one that is not finite or out of
            range is a fault, and zeros are sent in place of all of them.
        now_ns : int
            Time of this cycle [ns], never decreasing; it drives heartbeats and time limits.

        Raises
        ------
        HardwareError
            If the connection to the bus is gone, before `configure`, or for a wrong shape.
        """

    @abstractmethod
    def vent(self) -> None:
        """Command 0 Pa for every chamber at once, without slew; idempotent, from any state, never raises.

        Nothing is sent before the first `configure` (the devices are safe by themselves) or while the
        connection is gone. Devices with a watchdog vent then; where they have none a call takes a step to get
        the connection back, also after a start-up that has failed.
        """

    @abstractmethod
    def close(self) -> None:
        """Bring the pressures down, the devices to rest, and let the bus go; idempotent, never raises."""
