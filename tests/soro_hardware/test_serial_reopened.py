"""Serial ports that go and come back, or are not there: what is behind them is not left at its pressure."""

import numpy as np
import pytest
from hardware_bench import emulator, wait_for
from rest_bench import FAMILIES, SETTLED_PA
from serial_bench import itv, platform_file

from soro_core.errors import HardwareError
from soro_hardware import load_platform, open_regulator
from soro_hardware.emulation.sockets.plant_link import PlantLinkClient
from tests.refused import fails

serial = pytest.mark.parametrize("family", ["itv_rs232", "alicat", "alicat at 19200 with firmware 5"])


@serial
@pytest.mark.parametrize("way", ["exchange", "vent"])
def test_devices_that_kept_their_pressure_get_zeros_as_soon_as_their_port_is_there_again(family, way):
    """Nobody else vents them; without the start-up, which waits for a person's reset."""
    rig = FAMILIES[family](0.0)
    rig.configure()
    for _ in range(200):
        rig.exchange(40e3)
    rig.ports[0].gone = True
    for _ in range(5):
        with fails(HardwareError, code="gone"):
            rig.exchange(40e3)
    assert rig.demand_pa[0] > 35e3
    rig.ports[0].gone = False
    for _ in range(rig.patience):
        result = rig.exchange(40e3) if way == "exchange" else rig.driver.vent()
    assert np.abs(rig.demand_pa).max() <= SETTLED_PA
    if result is not None:
        assert {fault.code for fault in result.faults} == {"connection_lost"}
        assert not result.sent_pa.any()
        assert rig.told.pressed is False, "all were seen at zero"
    rig.driver.configure()
    assert rig.exchange(0.0).faults == ()


def test_a_start_up_without_ports_does_not_end_the_vent(monkeypatch):
    """As after a reset that was refused."""
    rig = FAMILIES["itv_rs232"](0.0)
    rig.configure()
    for _ in range(100):
        rig.exchange(40e3)

    def none():
        raise HardwareError("no ports", code="open")

    with monkeypatch.context() as patch:
        patch.setattr(rig.driver, "_open_ports", none)
        with fails(HardwareError, code="open"):
            rig.driver.configure()
    for _ in range(rig.patience):
        rig.driver.vent()
    assert np.abs(rig.demand_pa).max() <= SETTLED_PA


@pytest.mark.process
def test_a_port_that_is_not_there_leaves_no_pressure_behind_the_others(tmp_path):
    """At the first start-up too, with power-up set points; the missing one is named."""
    path = platform_file(
        tmp_path,
        itv(line={"reconnect_s": 0.0, "supervisor": False}, emulation={"wake_pa": 30e3, "boot_delay_s": 0.0}),
    )
    with emulator(tmp_path, platform=path) as served:
        link = PlantLinkClient(served.plant)
        wait_for(lambda: (frame := link.latest()) is not None and frame.pressures.min() > 25e3)
        names = [str(tmp_path / "adapter" / name) for name in ("none", "1", "2")]
        regulator = open_regulator(load_platform(path), ",".join(names))
        with fails(HardwareError, "No such file", device=names[0], code="open"):
            regulator.configure()
        wait_for(lambda: link.latest().pressures[1:].max() < 2e3)
        assert link.latest().pressures[0] > 25e3
        regulator.close()
        link.close()
