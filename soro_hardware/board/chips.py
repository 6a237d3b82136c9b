"""The two chips of a port, as bytes on I2C: MCP4725 (DAC) and ADS1013, ADS1014, ADS1015 (ADC).

MCP4725 data sheet DS22039D section 6, ADS101x data sheet SBAS473 section "register map". Both have 12 bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

CODES = 4096


class I2cBus(Protocol):
    """One I2C bus; a device without an answer, or a blocked bus, is an `OSError`."""

    def write(self, address: int, data: bytes) -> None:
        """Write bytes to a device."""

    def read(self, address: int, length: int) -> bytes:
        """Read bytes from a device."""

    def close(self) -> None:
        """Close the bus."""


# -- MCP4725 -------------------------------------------------------------------------------------------------

_READY, _POWER_DOWN = 0x80, 0x06
_WRITE_STORED = 0x60  # command 011: DAC register and EEPROM


@dataclass(frozen=True)
class DacState:
    """State of a DAC: its code, its code at power-on, and whether it is ready and on."""

    code: int
    stored_code: int
    ready: bool
    on: bool


def write_dac(bus: I2cBus, address: int, code: int) -> None:
    """Set the output of a DAC with a fast write of two bytes.

    Parameters
    ----------
    bus : I2cBus
        Bus of the chip.
    address : int
        Address of the chip.
    code : int
        Output, 0 to 4095 of full scale.
    """
    bus.write(address, bytes((code >> 8, code & 0xFF)))


def store_dac(bus: I2cBus, address: int, code: int) -> None:
    """Set the output of a DAC, now and at power-on; parameters as in `write_dac`.

    It takes 50 ms and is possible 1e6 times.
    """
    bus.write(address, bytes((_WRITE_STORED, code >> 4, (code & 0xF) << 4)))


def read_dac(bus: I2cBus, address: int) -> DacState:
    """Read the state of a DAC."""
    status, high, low, stored_high, stored_low = bus.read(address, 5)
    return DacState(
        code=high << 4 | low >> 4,
        stored_code=(stored_high & 0x0F) << 8 | stored_low,
        ready=bool(status & _READY),
        on=not status & _POWER_DOWN,
    )


# -- ADS101x -------------------------------------------------------------------------------------------------

_CONVERSION, _CONFIG = 0x00, 0x01
_START = 1 << 15
RATES_SPS = {128: 0, 250: 1, 490: 2, 920: 3, 1600: 4, 2400: 5, 3300: 6}
# Full scale [V] of each setting of the amplifier; the published board uses 2.048 V ("gain 2").
FULL_SCALES_V = {6.144: 0, 4.096: 1, 2.048: 2, 1.024: 3, 0.512: 4, 0.256: 5}


def adc_config(rate_sps: int, full_scale_v: float) -> int:
    """Return a configuration word: input 0 against ground, continuous conversion, comparator off."""
    return _START | 0b100 << 12 | FULL_SCALES_V[full_scale_v] << 9 | RATES_SPS[rate_sps] << 5 | 0b00011


def start_adc(bus: I2cBus, address: int, config: int) -> None:
    """Configure an ADC and select its conversion register, so that each later reading is two bytes.

    Parameters
    ----------
    bus : I2cBus
        Bus of the chip.
    address : int
        Address of the chip.
    config : int
        Configuration word of `adc_config`.
    """
    bus.write(address, bytes((_CONFIG, config >> 8, config & 0xFF)))
    bus.write(address, bytes((_CONVERSION,)))


def read_adc_config(bus: I2cBus, address: int) -> int:
    """Read the configuration of an ADC, without the bit of a running conversion."""
    bus.write(address, bytes((_CONFIG,)))
    word = int.from_bytes(bus.read(address, 2), "big")
    bus.write(address, bytes((_CONVERSION,)))
    return word & ~_START


def read_adc(bus: I2cBus, address: int) -> int:
    """Return the newest conversion of an ADC in counts, -2048 to 2047."""
    return int.from_bytes(bus.read(address, 2), "big", signed=True) >> 4


def same_config(found: int, wanted: int) -> bool:
    """Return whether a configuration that was read is the wanted one."""
    return found == wanted & ~_START
