"""The two drivers on serial lines: SMC ITV with one port each, Alicat with one port for all units."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from soro_core.errors import HardwareError
from soro_hardware.serial_line import alicat
from soro_hardware.serial_line.alicat import AlicatChannel
from soro_hardware.serial_line.config import AlicatPlatform, ItvPlatform, SerialPlatform
from soro_hardware.serial_line.driver import SerialRegulator
from soro_hardware.serial_line.itv import ItvChannel
from soro_hardware.serial_line.line.engine import LineEngine
from soro_hardware.serial_line.line.port import BytePort, SerialPort, open_with_retries, paths_of
from soro_hardware.serial_line.line.session import StartupSession


class ItvRegulator(SerialRegulator):
    """SMC ITV, one port each."""

    platform: ItvPlatform

    def make_lines(self, ports: Sequence[BytePort]) -> list[LineEngine]:
        times, baud = self.platform.line, self.platform.baud
        return [
            LineEngine(
                port,
                [ItvChannel(self.platform, valve, port.name)],
                baud,
                times.answer_timeout_s,
                times.quiet_s,
            )
            for valve, port in zip(self.platform.valves, ports, strict=True)
        ]


class AlicatRegulator(SerialRegulator):
    """Alicat pressure controllers on one port."""

    platform: AlicatPlatform

    @property
    def update_hz(self) -> float:
        with_ls = all(isinstance(c, AlicatChannel) and c.is_modern for c in self._channels)
        return self.platform.served_hz(with_ls)

    def make_lines(self, ports: Sequence[BytePort]) -> list[LineEngine]:
        (port,) = ports
        times, baud = self.platform.line, self.platform.baud
        channels = [AlicatChannel(self.platform, valve, port.name) for valve in self.platform.valves]
        return [LineEngine(port, channels, baud, times.answer_timeout_s, times.quiet_s)]

    def stop_streaming(self, session: StartupSession) -> None:
        alicat.stop_stream(session, tuple(valve.unit for valve in self.platform.valves))


def open_itv(
    platform: ItvPlatform, endpoint: str | None, clock: Callable[[], float], lockstep: bool
) -> ItvRegulator:
    """Make the driver of a platform; parameters as in `Family.open`."""
    return ItvRegulator(
        platform, lambda: _open(platform, endpoint, len(platform.valves), clock), clock, lockstep
    )


def open_alicat(
    platform: AlicatPlatform, endpoint: str | None, clock: Callable[[], float], lockstep: bool
) -> AlicatRegulator:
    """Make the driver of a platform; parameters as in `Family.open`."""
    return AlicatRegulator(platform, lambda: _open(platform, endpoint, 1, clock), clock, lockstep)


def _open(
    platform: SerialPlatform, endpoint: str | None, count: int, clock: Callable[[], float]
) -> list[SerialPort]:
    named = endpoint or platform.device
    if named is None:
        raise HardwareError(
            "no port named: give it in the platform, or an endpoint", platform.family, "setting"
        )
    ports: list[SerialPort] = []
    end_s = clock() + platform.line.reconnect_s
    for path in paths_of(named, count):
        try:
            ports.append(open_with_retries(path, platform.baud, end_s - clock(), clock))
        except HardwareError:  # the devices on the other ports must still be vented
            ports.append(SerialPort(path, platform.baud, is_there=False))
    return ports
