"""Open the CAN bus of a platform; each error is one line with advice."""

from __future__ import annotations

import errno
import re

import can

from soro_core.config import with_changes
from soro_core.errors import HardwareError
from soro_hardware.transport.config import (
    CanTransport,
    PythonCanTransport,
    SlcanTransport,
    SocketcandTransport,
    SocketcanTransport,
)
from soro_hardware.transport.slcan import SlcanBus
from soro_hardware.transport.socketcand import SocketcandBus
from soro_hardware.transport.stream import StreamBus

_ADDRESS = re.compile(r"[\w.-]+:\d+")


def open_bus(transport: CanTransport, endpoint: str | None = None, lockstep: bool = False) -> can.BusABC:
    """Open a bus.

    Parameters
    ----------
    transport : CanTransport
        Transport of a platform.
    endpoint : str, optional
        Replaces the platform's device: the path of a serial port or pseudo-terminal (slcan, for every
        transport of the platform), ``host:port`` (socketcand), or the name of a channel.
    lockstep : bool
        Whether the bus is that of an emulator in lockstep.

    Raises
    ------
    HardwareError
        If there is no such adapter, interface or server.
    """
    if endpoint is not None:
        transport = _replaced(transport, endpoint)
    if isinstance(transport, SlcanTransport | SocketcandTransport):
        own: StreamBus = (
            SlcanBus.from_transport(transport)
            if isinstance(transport, SlcanTransport)
            else SocketcandBus.from_transport(transport)
        )
        if lockstep and isinstance(own, SlcanBus) and not own.acknowledges:
            own.shutdown()
            text = "the adapter never acknowledges, as lockstep needs: run it in real time"
            raise HardwareError(text, own.channel_info, "setting")
        own.lockstep = lockstep
        return own
    if isinstance(transport, SocketcanTransport):
        return _python_can("socketcan", transport.channel, {}, transport.bitrate)
    assert isinstance(transport, PythonCanTransport)
    options = {"bitrate": transport.bitrate, **transport.options}
    return _python_can(transport.interface, transport.channel, options, transport.bitrate)


def _replaced(transport: CanTransport, endpoint: str) -> CanTransport:
    bitrate, timeout_s = transport.bitrate, transport.open_timeout_s
    if _ADDRESS.fullmatch(endpoint):
        host, port = endpoint.rsplit(":", 1)
        channel = transport.channel if isinstance(transport, SocketcandTransport) else "can0"
        return SocketcandTransport(
            kind="socketcand",
            host=host,
            port=int(port),
            channel=channel,
            bitrate=bitrate,
            open_timeout_s=timeout_s,
        )
    if isinstance(transport, SlcanTransport):
        return with_changes(transport, device=endpoint)
    if "/" in endpoint:
        return SlcanTransport(kind="slcan", device=endpoint, bitrate=bitrate, open_timeout_s=timeout_s)
    return with_changes(transport, channel=endpoint)


def _python_can(
    interface: str, channel: str | int, options: dict[str, bool | int | float | str], bitrate: int
) -> can.BusABC:
    known = sorted(can.VALID_INTERFACES)
    if interface not in known:
        raise HardwareError(
            f"python-can has no interface {interface!r}; it knows {', '.join(known)}", code="setting"
        )
    try:
        return can.Bus(interface=interface, channel=channel, ignore_config=True, **options)
    except (can.CanError, OSError, ImportError, ValueError, TypeError, AttributeError) as error:
        raise HardwareError(explain(error, str(channel), bitrate), f"{interface} {channel}", "open") from None


def explain(error: Exception, channel: str, bitrate: int) -> str:
    """Return the reason of an error in one line, with advice if the cause is known.

    Parameters
    ----------
    error : Exception
        Error of python-can or of the system.
    channel : str
        Name of the interface.
    bitrate : int
        Bit rate [bit/s].
    """
    number = getattr(error, "errno", None) or getattr(error, "error_code", None)
    cause = error.__cause__ or error.__context__
    if number is None and isinstance(cause, OSError):
        number = cause.errno
    if number == errno.ENODEV:
        return "no such network interface: plug the adapter in; `ip link` lists what there is"
    if number in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        return "this kernel has no CAN sockets: load the modules can and can_raw (`sudo modprobe can_raw`)"
    if number == errno.ENETDOWN:
        return f"the interface is down: `sudo ip link set {channel} up type can bitrate {bitrate}`"
    if number in (errno.EPERM, errno.EACCES):
        return "no permission to open it"
    text = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, can.CanInterfaceNotImplementedError | ImportError):
        return f"its driver or Python package is missing ({text})"
    return text
