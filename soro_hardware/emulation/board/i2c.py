"""An I2C bus with emulated chips: registers, conversion times and power-up values."""

from __future__ import annotations

import errno
from collections.abc import Callable

from soro_hardware.board.chips import FULL_SCALES_V, RATES_SPS

_FREQUENCY_HZ = 400e3  # clock of the bus
_STORE_NS = 25_000_000  # typical time of an EEPROM write
_FACTORY_CODE = 0x800  # middle of the range
_FACTORY_CONFIG = 0x8583
_PERIODS_NS = {bits: round(1e9 / rate) for rate, bits in RATES_SPS.items()} | {7: round(1e9 / 3300)}
_FULL_SCALES = {bits: volts for volts, bits in FULL_SCALES_V.items()}


class EmulatedMcp4725:
    """DAC; `log` lists the changes of the output as (time [ns], code)."""

    def __init__(self, stored_code: int = _FACTORY_CODE) -> None:
        self.stored_code = stored_code
        self.now_ns = 0
        self.log: list[tuple[int, int]] = []
        self.power_up()

    def power_up(self) -> None:
        """Start as after a loss of power: the output is the code in the EEPROM."""
        self.code, self.power_down = self.stored_code, 0
        self._busy_until_ns = 0
        self.log.append((self.now_ns, self.code))

    @property
    def fraction(self) -> float:
        """Output over full scale."""
        return 0.0 if self.power_down else self.code / 4096

    def advance(self, now_ns: int) -> None:
        self.now_ns = now_ns

    def write(self, data: bytes) -> None:
        if self.now_ns < self._busy_until_ns:
            return  # during an EEPROM write the chip acknowledges and ignores commands
        while data:
            command = data[0] >> 5
            if command in (0, 1) and len(data) >= 2:  # fast: bit 5 belongs to the power-down bits
                self._set((data[0] & 0x0F) << 8 | data[1], data[0] >> 4 & 3)
                data = data[2:]
            elif command in (2, 3) and len(data) >= 3:
                self._set(data[1] << 4 | data[2] >> 4, data[0] >> 1 & 3)
                if command == 3:
                    self.stored_code = self.code
                    self._busy_until_ns = self.now_ns + _STORE_NS
                    return
                data = data[3:]
            else:
                return

    def read(self, length: int) -> bytes:
        ready = self.now_ns >= self._busy_until_ns
        block = bytes(
            (
                ready << 7 | 0x40 | self.power_down << 1,
                self.code >> 4,
                (self.code & 0xF) << 4,
                self.stored_code >> 8,
                self.stored_code & 0xFF,
            )
        )
        return (block * (length // 5 + 1))[:length]

    def _set(self, code: int, power_down: int) -> None:
        self.code, self.power_down = code, power_down
        self.log.append((self.now_ns, code))


class EmulatedAds1015:
    """ADC; `volts` returns the voltage at input 0, and inputs 1 to 3 are at ground."""

    def __init__(self, volts: Callable[[], float]) -> None:
        self._volts = volts
        self.now_ns = 0
        self.power_up()

    def power_up(self) -> None:
        """Start as after a loss of power: idle, without a conversion."""
        self._pointer, self._config, self._conversion = 0, _FACTORY_CONFIG, 0
        self._thresholds = {2: 0x8000, 3: 0x7FF0}
        self._done_ns: int | None = None  # when the running conversion ends

    @property
    def continuous(self) -> bool:
        """Whether the ADC converts continuously."""
        return not self._config & 0x0100

    def advance(self, now_ns: int) -> None:
        """Advance to a time [ns]; a conversion that ends samples the present voltage."""
        self.now_ns = now_ns
        if self._done_ns is not None and now_ns >= self._done_ns:
            self._conversion = self._convert()
            period = _PERIODS_NS[self._config >> 5 & 7]
            passed = (now_ns - self._done_ns) // period + 1
            self._done_ns = self._done_ns + passed * period if self.continuous else None

    def write(self, data: bytes) -> None:
        if not data:
            return
        self._pointer = data[0] & 3
        if len(data) < 3:
            return
        word = data[1] << 8 | data[2]
        if self._pointer == 1:
            idle = self._done_ns is None or self.continuous
            self._config = word & 0x7FFF
            if self.continuous or (word & 0x8000 and idle):
                self._done_ns = self.now_ns + _PERIODS_NS[word >> 5 & 7]
            elif idle:
                self._done_ns = None
        elif self._pointer in self._thresholds:
            self._thresholds[self._pointer] = word

    def read(self, length: int) -> bytes:
        if self._pointer == 0:
            word = self._conversion & 0xFFFF
        elif self._pointer == 1:
            word = self._config | (self._done_ns is None) << 15
        else:
            word = self._thresholds[self._pointer]
        return (word.to_bytes(2, "big") * (length // 2 + 1))[:length]

    def _convert(self) -> int:
        positive, negative = [
            (0, 1), (0, 3), (1, 3), (2, 3), (0, None), (1, None), (2, None), (3, None)
        ][self._config >> 12 & 7]  # fmt: skip
        volts = [self._volts(), 0.0, 0.0, 0.0]
        difference = volts[positive] - (0.0 if negative is None else volts[negative])
        full_scale = _FULL_SCALES.get(self._config >> 9 & 7, 0.256)
        return max(-2048, min(round(difference / full_scale * 2048), 2047)) << 4


Chip = EmulatedMcp4725 | EmulatedAds1015


class EmulatedI2c:
    """One I2C bus.

    Parameters
    ----------
    chips : dict
        Chip at each address.
    wait : callable, optional
        Called with the duration [s] of each transfer; for measurements.

    Attributes
    ----------
    broken : dict
        Error number with which transfers to an address fail: ENXIO for a chip that does not answer,
        ETIMEDOUT for a blocked line.
    log : list or None
        If it is a list, every transfer is appended as text.
    """

    def __init__(
        self,
        chips: dict[int, Chip],
        wait: Callable[[float], None] = lambda seconds: None,
    ) -> None:
        self.chips = chips
        self.broken: dict[int, int] = {}
        self.log: list[str] | None = None
        self._wait, self._bit_s = wait, 1.0 / _FREQUENCY_HZ

    def advance(self, now_ns: int) -> None:
        """Advance the time of every chip."""
        for chip in self.chips.values():
            chip.advance(now_ns)

    def write(self, address: int, data: bytes) -> None:
        self._transfer(address, len(data))
        self.chips[address].write(data)
        self._note("<", address, data)

    def read(self, address: int, length: int) -> bytes:
        self._transfer(address, length)
        data = self.chips[address].read(length)
        self._note(">", address, data)
        return data

    def close(self) -> None:
        pass

    def _transfer(self, address: int, length: int) -> None:
        self._wait((9 * (length + 1) + 2) * self._bit_s)  # nine clocks for each byte, start and stop
        number = self.broken.get(address, 0 if address in self.chips else errno.ENXIO)
        if number:
            raise OSError(number, errno.errorcode[number])

    def _note(self, mark: str, address: int, data: bytes) -> None:
        if self.log is not None:
            self.log.append(f"{mark} {address:02X} {data.hex(' ').upper()}")
