"""Transports to a CAN bus in a platform file, each with its `kind`."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, field_validator

from soro_core.config import Strict

# Bit rates of the LAWICEL command S. 800k (S7) is left out: libraries disagree on it (750k in python-can).
BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 1_000_000)


class CanTransport(Strict):
    """Keys of all transports to a CAN bus."""

    bitrate: int = Field(1_000_000, description="CAN bit rate [bit/s]")
    open_timeout_s: float = Field(
        1.0, gt=0, le=10, description="time in which the adapter or server must answer"
    )

    @field_validator("bitrate")
    @classmethod
    def _known_bitrate(cls, value: int) -> int:
        if value not in BITRATES:
            raise ValueError(f"one of {', '.join(map(str, BITRATES))} bit/s")
        return value

    @property
    def address(self) -> str | None:
        """Path, name or address to open, or None if the platform file states none."""
        return None


class SlcanTransport(CanTransport):
    """A CAN adapter with the protocol LAWICEL ASCII (slcan) on a serial port or a pseudo-terminal."""

    kind: Literal["slcan"]
    device: str | None = Field(
        None, description="path of the serial port; none: the user gives it with --device"
    )
    serial_baud: int = Field(1_000_000, ge=9600, le=12_000_000, description="baud rate of the serial port")
    acknowledges: bool | None = Field(
        None,
        description="whether the adapter acknowledges commands; false: never, as the CANable with its stock "
        "firmware; none: found out when it is opened",
    )

    @property
    def address(self) -> str | None:
        return self.device


class SocketcanTransport(CanTransport):
    """A network interface of the Linux kernel; its bit rate is set with `ip link`, and only noted here."""

    kind: Literal["socketcan"]
    channel: str = Field(min_length=1, max_length=15, description="name of the interface, for example can0")

    @property
    def address(self) -> str | None:
        return self.channel


class SocketcandTransport(CanTransport):
    """A CAN bus of another machine, served over TCP by socketcand."""

    kind: Literal["socketcand"]
    host: str | None = Field(None, description="name or address; none: the user gives it with --device")
    port: int = Field(29536, ge=1, le=65535)
    channel: str = Field("can0", min_length=1, max_length=15, description="name of the bus on the server")

    @property
    def address(self) -> str | None:
        return None if self.host is None else f"{self.host}:{self.port}"


class PythonCanTransport(CanTransport):
    """Any interface of python-can, by its name (pcan, kvaser, ixxat, vector, gs_usb, ...)."""

    kind: Literal["python_can"]
    interface: str = Field(min_length=1, description="name of the interface in python-can")
    channel: str | int = Field(description="channel as the interface requires it")
    options: dict[str, bool | int | float | str] = Field(
        default_factory=dict, description="further arguments of the interface"
    )

    @property
    def address(self) -> str | None:
        return str(self.channel)


Transport: TypeAlias = Annotated[
    SlcanTransport | SocketcanTransport | SocketcandTransport | PythonCanTransport,
    Field(discriminator="kind"),
]
