"""Emulated MCP4725 and ADS1015 beside their data sheets, and the bytes that the server sends them."""

import errno

import pytest

from soro_hardware.board import chips
from soro_hardware.emulation.board.i2c import EmulatedAds1015, EmulatedI2c, EmulatedMcp4725

MS = 1_000_000


@pytest.fixture
def dac():
    return EmulatedMcp4725()


@pytest.fixture
def bus(dac):
    bus = EmulatedI2c({0x60: dac, 0x48: EmulatedAds1015(lambda: bus.volts)})
    bus.volts = 1.0
    bus.log = []
    return bus


def test_dac_starts_with_what_its_eeprom_holds(bus):
    assert bus.read(0x60, 5) == bytes.fromhex("C0 80 00 08 00")  # the factory's middle of the range
    assert chips.read_dac(bus, 0x60) == chips.DacState(0x800, 0x800, True, True)


def test_fast_write(bus, dac):
    chips.write_dac(bus, 0x60, 0xABC)
    assert bus.log == ["< 60 0A BC"]
    assert dac.fraction == 0xABC / 4096
    assert chips.read_dac(bus, 0x60) == chips.DacState(0xABC, 0x800, True, True)
    dac.power_up()
    assert dac.code == 0x800


def test_fast_write_repeated_in_one_transfer(bus, dac):
    bus.write(0x60, bytes.fromhex("0123 0456"))
    assert dac.code == 0x456


def test_power_down_bits(bus, dac):
    bus.write(0x60, bytes.fromhex("1ABC"))
    assert dac.fraction == 0.0
    assert not chips.read_dac(bus, 0x60).on


def test_stored_code(bus, dac):
    chips.store_dac(bus, 0x60, 0x123)
    assert bus.log == ["< 60 60 12 30"]
    chips.write_dac(bus, 0x60, 0xFFF)  # ignored while the EEPROM is written
    assert chips.read_dac(bus, 0x60) == chips.DacState(0x123, 0x123, False, True)
    bus.advance(50 * MS)
    chips.write_dac(bus, 0x60, 0xFFF)
    assert chips.read_dac(bus, 0x60) == chips.DacState(0xFFF, 0x123, True, True)
    dac.power_up()
    assert dac.code == 0x123


def test_half_a_command_and_reserved_ones_do_nothing(bus, dac):
    for data in ("", "0A", "40", "40FF", "80FFF0", "E0FFF0"):
        bus.write(0x60, bytes.fromhex(data))
        assert dac.code == 0x800


def test_configuration_word():
    assert chips.adc_config(490, 2.048) == 0xC443  # as of the published board: gain 2, 490 SPS, continuous
    assert chips.adc_config(920, 4.096) == 0xC263


@pytest.mark.parametrize(("rate", "period_us"), [(490, 2041), (920, 1087)])
def test_conversion_time(bus, rate, period_us):
    chips.start_adc(bus, 0x48, chips.adc_config(rate, 2.048))
    bus.advance((period_us - 2) * 1000)
    assert chips.read_adc(bus, 0x48) == 0, "nothing has been converted yet"
    bus.advance((period_us + 1) * 1000)
    assert chips.read_adc(bus, 0x48) == 1000
    bus.volts = -0.5
    bus.advance((2 * period_us - 2) * 1000)
    assert chips.read_adc(bus, 0x48) == 1000
    bus.advance((2 * period_us + 1) * 1000)
    assert chips.read_adc(bus, 0x48) == -500


def test_adc_bytes(bus):
    config = chips.adc_config(490, 2.048)
    chips.start_adc(bus, 0x48, config)
    bus.advance(3 * MS)
    chips.read_adc(bus, 0x48)
    assert bus.log == ["< 48 01 C4 43", "< 48 00", "> 48 3E 80"]
    assert chips.same_config(chips.read_adc_config(bus, 0x48), config)
    assert chips.read_adc(bus, 0x48) == 1000, "it points at the conversion register again"


def test_adc_saturates(bus):
    chips.start_adc(bus, 0x48, chips.adc_config(490, 2.048))
    for volts, counts in ((5.0, 2047), (-5.0, -2048)):
        bus.volts = volts
        bus.advance(bus.chips[0x48].now_ns + 10 * MS)
        assert chips.read_adc(bus, 0x48) == counts


def test_adc_single_shot_and_factory_setting(bus):
    assert bus.read(0x48, 2) == b"\x00\x00"
    bus.write(0x48, b"\x01")
    assert bus.read(0x48, 2) == bytes.fromhex("8583")  # idle, 1600 SPS, input 0 against input 1
    bus.write(0x48, bytes.fromhex("01 C5 83"))
    assert bus.read(0x48, 2) == bytes.fromhex("4583"), "busy"
    bus.advance(MS)
    assert bus.read(0x48, 2) == bytes.fromhex("C583"), "done"
    bus.write(0x48, b"\x00")
    assert bus.read(0x48, 2) == bytes.fromhex("3E80")
    bus.volts = 0.1
    bus.advance(100 * MS)
    assert bus.read(0x48, 2) == bytes.fromhex("3E80"), "one conversion only"


def test_adc_loses_its_configuration_with_its_power(bus):
    config = chips.adc_config(490, 2.048)
    chips.start_adc(bus, 0x48, config)
    bus.chips[0x48].power_up()
    assert not chips.same_config(chips.read_adc_config(bus, 0x48), config)


def test_absent_and_held():
    bus = EmulatedI2c({0x60: EmulatedMcp4725()})
    with pytest.raises(OSError, match="ENXIO"):
        bus.read(0x61, 1)
    bus.broken[0x60] = errno.ETIMEDOUT
    with pytest.raises(TimeoutError):
        bus.write(0x60, b"\x00\x00")


def test_time_on_the_wire():
    waits = []
    bus = EmulatedI2c({0x60: EmulatedMcp4725()}, waits.append)
    chips.write_dac(bus, 0x60, 0)
    assert waits == [pytest.approx(29 / 400e3)]
