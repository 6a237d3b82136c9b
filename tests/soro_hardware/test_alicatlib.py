"""The emulated Alicat controllers, seen by an independent driver: alicatlib, over real bytes.

Driver and emulated device share a codec, so that a standard that both misread would not show. This package
was written against captures of real devices. It wants Python 3.13.
"""

import pytest
from serial_bench import alicat, quiet
from served_bench import served

alicatlib = pytest.importorskip("alicatlib", reason="alicatlib is installed with Python 3.13 and newer")
import anyio  # noqa: E402 - comes with it
from alicatlib import open_device  # noqa: E402
from alicatlib.devices.pressure_controller import PressureController  # noqa: E402
from alicatlib.transport import SerialSettings  # noqa: E402

# Those of which its authors have captures, and the first that knows LS.
FIRMWARE = (
    "5v12.0-R22",
    "6v21.0-R22",
    "7v09.0-R22",
    "8v17.0-R23",
    "8v30.0-R23",
    "9v00.0-R23",
    "10v03.0-R24",
    "10v20.0-R24",
)


def pressure_of(reading):
    """The pressure, as the firmware names it."""
    return reading.values.get("Gauge_Press", reading.values.get("Pressure"))


async def identify_poll_and_command(address, unit):
    """What it finds: the device, two readings, and what a set point is answered."""
    settings = SerialSettings(port=address, baudrate=115200)
    async with await open_device(address, unit_id=unit, serial=settings) as device:
        before = await device.poll()
        answer = await device.setpoint(20.0)
        for _ in range(100):
            after = await device.poll()
            if abs(pressure_of(after) - answer.requested) < 0.2:
                break
            await anyio.sleep(0.02)
        await device.setpoint(0.0)
        return device, before, answer, after


@pytest.mark.parametrize("firmware", FIRMWARE)
def test_it_identifies_polls_and_commands_the_unit_by_itself(firmware):
    platform = alicat(2, **quiet(firmware=firmware))
    with served(platform) as (devices, address):
        device, before, answer, after = anyio.run(identify_poll_and_command, address, "B")
        assert isinstance(device, PressureController)
        assert device.info.model == "PC-103KPAG-D"
        assert device.info.software == firmware
        assert device.info.firmware.raw.startswith(firmware.split(".")[0])
        assert pressure_of(before) == pytest.approx(0.0, abs=0.2)
        assert answer.requested == 20.0
        assert pressure_of(after) == pytest.approx(answer.requested, abs=0.2)
        assert devices.valves[0].setpoint == 0.0, "the other unit on the line is left alone"
        assert devices.valves[1].setpoint == 0.0
