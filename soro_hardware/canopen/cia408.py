"""CiA 408 (fluid power) for a pressure valve: objects, state machine, scaling of pressures.

State machine after the figure of the profile: the control word requests a state with three bits (D, H, M);
the status word answers with the same bits and R (ready). R = 0 outside NOT_READY is a fault, which only an
edge of the reset bit ends. So the state is ACTIVE only if R is also set.
"""

from __future__ import annotations

import math
from enum import Enum, IntEnum

# Objects of the communication profile
DEVICE_TYPE, ERROR_REGISTER, CYCLE_PERIOD, IDENTITY = 0x1000, 0x1001, 0x1006, 0x1018
GUARD_TIME, LIFE_TIME_FACTOR = 0x100C, 0x100D
CONSUMER_HEARTBEAT, PRODUCER_HEARTBEAT, ERROR_BEHAVIOUR = 0x1016, 0x1017, 0x1029
RPDO_COMMUNICATION, RPDO_MAPPING, TPDO_COMMUNICATION, TPDO_MAPPING = 0x1400, 0x1600, 0x1800, 0x1A00
ERROR_GENERIC, ERROR_COMMUNICATION = 1 << 0, 1 << 4  # bits of the error register

UNIT_NORMALISED, UNIT_PA, UNIT_BAR = 0x00, 0x22, 0x4E
FULL_SCALE_COUNTS = 16384  # 100 % where the unit is 0
_PA_PER_UNIT = {UNIT_PA: 1.0, UNIT_BAR: 1e5}


class Control(IntEnum):
    """Control words up to ACTIVE, and the reset bit."""

    INIT = 0b000
    DISABLED = 0b001
    HOLD = 0b011
    ACTIVE = 0b111
    RESET = 0b1000


class ValveState(Enum):
    """States of the valve; the value is the low nibble of the status word (RMHD)."""

    NOT_READY = ("not ready", 0b0000)
    INIT = ("init", 0b1000)
    DISABLED = ("disabled", 0b1001)
    HOLD = ("hold", 0b1011)
    ACTIVE = ("active", 0b1111)
    FAULT_REACTION = ("fault reaction", 0b0111)
    FAULT_HOLD = ("fault hold", 0b0011)
    FAULT_DISABLED = ("fault disabled", 0b0001)
    FAULT_INIT = ("fault init", 0b0000)

    bits: int
    """R, M, H and D of the status word."""
    is_fault: bool
    """Whether the state is a fault state."""

    def __init__(self, text: str, bits: int) -> None:
        self.bits, self.is_fault = bits, text.startswith("fault")


STATUS_CONTROL_EFFECTIVE, STATUS_LIMIT = 1 << 8, 1 << 10

_ORDER = (ValveState.INIT, ValveState.DISABLED, ValveState.HOLD, ValveState.ACTIVE)
_AFTER_RESET = {
    ValveState.FAULT_HOLD: ValveState.HOLD,
    ValveState.FAULT_DISABLED: ValveState.DISABLED,
    ValveState.FAULT_INIT: ValveState.INIT,
}


def next_state(state: ValveState, control: int, previous_control: int) -> ValveState:
    """Return the state after one control word: at most one step up, any number of steps down.

    Parameters
    ----------
    state : ValveState
        Present state.
    control, previous_control : int
        This control word and the last one; a rising edge of the reset bit resets a fault.
    """
    if state in _AFTER_RESET:
        reset = control & Control.RESET and not previous_control & Control.RESET
        return _AFTER_RESET[state] if reset else state
    if state not in _ORDER:
        return state
    wanted = 0
    while wanted < 3 and control >> wanted & 1:
        wanted += 1
    return _ORDER[min(_ORDER.index(state) + 1, wanted)]


def state_of(status: int) -> ValveState:
    """Return the state of a status word; 0000 is FAULT_INIT, its meaning after the boot of a device."""
    return _BY_BITS.get(status & 0xF, ValveState.NOT_READY)


_BY_BITS = {state.bits: state for state in ValveState}


def pascal_per_count(unit: int, prefix: int, full_scale_pa: float | None) -> float:
    """Return the pressure of one count of a device's pressure objects [Pa].

    Parameters
    ----------
    unit, prefix : int
        Sub-objects 2 and 3: SI unit code and power of ten.
    full_scale_pa : float or None
        Pressure of 16384 counts [Pa], for devices with normalised values (unit 0).

    Raises
    ------
    ValueError
        For an unknown unit, or unit 0 without full scale.
    """
    if unit == UNIT_NORMALISED:
        if full_scale_pa is None:
            raise ValueError(
                "the device's pressures are normalised: set canopen.full_scale_pa in the platform"
            )
        return full_scale_pa / FULL_SCALE_COUNTS
    if unit not in _PA_PER_UNIT:
        raise ValueError(
            f"unit 0x{unit:02X} of the device's pressures is unknown (known: 0x22 Pa, 0x4E bar, 0)"
        )
    # Positive powers of ten are exact; dividing by them brings 0.1 and the like as close as can be.
    return _PA_PER_UNIT[unit] * 10.0**prefix if prefix >= 0 else _PA_PER_UNIT[unit] / 10.0**-prefix


def counts_within(
    minimum_pa: float,
    maximum_pa: float,
    scale: float,
    zero: int = 0,
    limits: tuple[int, int] = (-32768, 32767),
) -> tuple[int, int]:
    """Return the smallest and the largest count within a range.

    Parameters
    ----------
    minimum_pa, maximum_pa : float
        Range [Pa gauge].
    scale : float
        Pressure of one count [Pa].
    zero : int
        Count at 0 Pa.
    limits : tuple of int
        Smallest and largest value of the object.

    Returns
    -------
    low, high : int
    """
    tolerance = 1e-9
    low = max(math.ceil(minimum_pa / scale - tolerance) + zero, limits[0])
    high = min(math.floor(maximum_pa / scale + tolerance) + zero, limits[1])
    return low, high


def limits_of(bits: int, is_signed: bool) -> tuple[int, int]:
    """Return the smallest and the largest value of an integer."""
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if is_signed else (0, (1 << bits) - 1)
