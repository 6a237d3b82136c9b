"""Payloads of the frames between the driver and `soro board`.

Pressures are int32 in Pa gauge: 1 Pa is far below one count of any converter, and an integer cannot be NaN.
Payloads, with n ports:

==========  ==============  ====================================================================
kind        direction       payload
==========  ==============  ====================================================================
HELLO       host to board   u16 number of ports that the host expects
SET         host to board   n x i32 set point; feeds the watchdog; sequence must grow
RESET       host to board   nothing; clears the latch, puts every port to 0 Pa, repeats the self-test
BYE         host to board   nothing; the board vents and waits for the next host
WELCOME     board to host   u32 boot number, u16 ports, u16 watchdog [ms], then n x (i32 lowest, i32 highest)
STATE       board to host   see `StateMessage`; sequence of the newest SET or RESET, 0 after HELLO
REFUSED     board to host   u16 `Refusal`, u16 port; sequence of the frame that is refused
==========  ==============  ====================================================================

A frame of the host has the number of its WELCOME, which only the host that has received it knows: a web page
can send bytes to any address, but it cannot read the answer. STATE is sent as the answer to every SET and,
when none comes, every 25 ms as the board's heartbeat.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass

from soro_hardware.board.frames import FrameType

NEVER_MS = 0xFFFF
_STATE = struct.Struct("<QBBH")
_PORT = struct.Struct("<iiHH")
_WELCOME = struct.Struct("<IHH")
_LIMITS = struct.Struct("<ii")
_REFUSED = struct.Struct("<HH")
_I32 = 2**31


class Refusal(enum.IntEnum):
    """Why the board refuses a frame."""

    BUSY = 1
    PORTS = 2
    RANGE = 3
    LATCHED = 4
    OLD = 5
    NO_HELLO = 6
    STRANGER = 7
    NUMBER = 8
    VERSION = 9


class Cause(enum.IntEnum):
    """Cause of the board's latch."""

    NONE = 0
    WATCHDOG = 1
    HOST_GONE = 2
    DEVICE_ERROR = 3
    CHIP_RESET = 4
    SELF_TEST = 5
    STOPPING = 6
    STOP_CONTACT = 7


class PortFlag(enum.IntFlag):
    """Errors of a port in one cycle."""

    NONE = 0
    DAC_ERROR = 1
    ADC_ERROR = 2
    OUT_OF_RANGE = 4
    CHIP_RESET = 8


@dataclass(frozen=True)
class PortState:
    """A port in a STATE frame: set point of the DAC, reading of the ADC [Pa gauge], errors, age [ms]."""

    applied_pa: int
    pressure_pa: int
    flags: PortFlag
    age_ms: int


@dataclass(frozen=True)
class StateMessage:
    """Payload of STATE: u64 time of the board [us], u8 armed, u8 `Cause`, u16 bad frames, n `PortState`."""

    time_us: int
    armed: bool
    cause: Cause
    garbled: int
    ports: tuple[PortState, ...]


@dataclass(frozen=True)
class Welcome:
    """Payload of WELCOME; `boot` differs at each start of the server."""

    boot: int
    watchdog_ms: int
    limits_pa: tuple[tuple[int, int], ...]


def lengths(ports: int) -> dict[FrameType, int]:
    """Return the length of the payload of each kind of frame, for a number of ports."""
    return {
        FrameType.HELLO: 2,
        FrameType.SET: 4 * ports,
        FrameType.RESET: 0,
        FrameType.BYE: 0,
        FrameType.WELCOME: _WELCOME.size + _LIMITS.size * ports,
        FrameType.STATE: _STATE.size + _PORT.size * ports,
        FrameType.REFUSED: _REFUSED.size,
    }


def pack_set(setpoint_pa: list[int]) -> bytes:
    """Payload of SET."""
    return struct.pack(f"<{len(setpoint_pa)}i", *setpoint_pa)


def unpack_set(payload: bytes) -> tuple[int, ...]:
    """The reverse of `pack_set`."""
    return struct.unpack(f"<{len(payload) // 4}i", payload)


def pack_hello(ports: int) -> bytes:
    """Payload of HELLO."""
    return struct.pack("<H", ports)


def unpack_hello(payload: bytes) -> int:
    """The reverse of `pack_hello`."""
    return int(struct.unpack("<H", payload)[0])


def pack_welcome(welcome: Welcome) -> bytes:
    """Payload of WELCOME."""
    head = _WELCOME.pack(welcome.boot, len(welcome.limits_pa), welcome.watchdog_ms)
    return head + b"".join(_LIMITS.pack(*pair) for pair in welcome.limits_pa)


def unpack_welcome(payload: bytes) -> Welcome:
    """The reverse of `pack_welcome`."""
    boot, _, watchdog_ms = _WELCOME.unpack_from(payload)
    return Welcome(boot, watchdog_ms, tuple(_LIMITS.iter_unpack(payload[_WELCOME.size :])))


def pack_state(state: StateMessage) -> bytes:
    """Payload of STATE."""
    head = _STATE.pack(state.time_us, state.armed, state.cause, state.garbled & 0xFFFF)
    return head + b"".join(
        _PORT.pack(_clip(p.applied_pa), _clip(p.pressure_pa), p.flags, min(p.age_ms, NEVER_MS))
        for p in state.ports
    )


def unpack_state(payload: bytes) -> StateMessage:
    """Decode a payload of `pack_state`.

    Raises
    ------
    ValueError
        If this version does not know the cause.
    """
    time_us, armed, cause, garbled = _STATE.unpack_from(payload)
    ports = tuple(
        PortState(a, p, PortFlag(f), age) for a, p, f, age in _PORT.iter_unpack(payload[_STATE.size :])
    )
    return StateMessage(time_us, bool(armed), Cause(cause), garbled, ports)


def pack_refused(why: Refusal, port: int = 0) -> bytes:
    """Payload of REFUSED."""
    return _REFUSED.pack(why, port)


def unpack_refused(payload: bytes) -> tuple[int, int]:
    """Reason and port of REFUSED."""
    why, port = _REFUSED.unpack(payload)
    return why, port


def _clip(value: int) -> int:
    return max(-_I32, min(value, _I32 - 1))
