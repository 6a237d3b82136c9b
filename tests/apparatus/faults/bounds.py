"""Bounds of the fault matrix: how quickly what must happen must happen, on which family."""

from __future__ import annotations

from soro_hardware import load_platform, open_regulator
from tests.apparatus.faults.rigs import PLATFORMS
from tests.apparatus.faults.rows import CHAMBER


def _serial_ms(family: str) -> float:
    """Bound of a serial line as its platform file is shipped."""
    driver = open_regulator(load_platform(PLATFORMS[family]), "not opened", lockstep=True)
    return 1e3 * (driver.reading_age_s + 1.0 / driver.update_hz)


FOUR = "canopen_408, 4 channels"
FAMILY_MS = {
    "canopen_408": 100.0,
    FOUR: 100.0,
    "itv_rs232": _serial_ms("itv_rs232"),  # 236 ms: at 9600 baud a round is 28 ms
    "alicat": _serial_ms("alicat"),  # 213 ms: three units at 115200 baud take 16 ms
    "veab_tcp": 150.0,
    "soro_board": 100.0,
    "vtem_modbus": 100.0,
}
SLOW = ("itv_rs232", "alicat")
# What is in the very next exchange.
AT_ONCE_MS = 10.0
# Faults begin on the rising flank of the circle, which leads 8 kPa away in less than 0.3 s; the monitor then
# looks on for 0.3 s. Readings that are off by a factor show it as the pressure grows, in another 0.6 s.
MOTION_MS, MODEL_MS, GROWTH_MS = 300.0, 300.0, 600.0
# Equal readings are a fault after 0.5 s, of which the first 0.3 s may hold no motion.
FROZEN_MS = 500.0
# What shows only while the set point falls has to wait for the top: half a circle, 1 s, at most.
TOP_MS = 1000.0
# A supply is told every 0.1 s, and may be low for as long.
SUPPLY_EVENT_MS, SUPPLY_MS = 100.0, 100.0
# A drift at rest: 0.5 s of rest and three windows of a third of a second, the first one perhaps under way.
DRIFT_MS = 1700.0

WRONG = rf"(implausible|stuck valve|frozen sensor): {CHAMBER} "
HIGH = rf"(over-pressure|short circuit|spike): {CHAMBER} "
IGNORED = "setpoint_ignored"
