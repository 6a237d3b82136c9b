"""Orderly shutdown: ramp to 0, wait for the pressure to go, control words 3, 1, 0, NMT stop."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import numpy as np

from soro_core.hardware import rest
from soro_core.hardware.canopen import frames
from soro_core.hardware.canopen.cia408 import CONSUMER_HEARTBEAT, LIFE_TIME_FACTOR, Control
from soro_core.hardware.canopen.frames import NmtCommand
from soro_core.hardware.canopen.sdo_client import SdoError
from soro_core.hardware.port import Array

if TYPE_CHECKING:
    from soro_core.hardware.canopen.driver import CanopenRegulator

LONGEST_WAIT_S = 1.0


def bring_down(driver: CanopenRegulator) -> None:
    """Run the sequence; a fault or a reading that never comes only makes it shorter, never endless.

    Raises
    ------
    HardwareError
        If the bus is gone.
    """
    platform = driver.platform
    period_s = 1.0 / platform.cycle_hz
    next_s = driver.clock()
    control = Control.HOLD if driver.latched or not driver.sent_pa.any() else Control.ACTIVE

    def cycle(setpoint: Array, word: Control) -> Array:
        nonlocal next_s
        driver.now_ns += round(period_s * 1e9)
        pressure = driver.command(setpoint, word)
        if not driver.lockstep:
            next_s = max(next_s + period_s, driver.clock())
            driver.wait(next_s)
        return pressure

    zeros = np.zeros_like(driver.sent_pa)
    rest.ramp_down(
        lambda setpoint: cycle(setpoint, control),
        zeros if driver.latched else driver.sent_pa,
        platform.shutdown_ramp_pa_s * period_s,
        1,
        round(LONGEST_WAIT_S / period_s),
    )
    for word in (Control.HOLD, Control.DISABLED, Control.INIT) if driver.device.has_states else ():
        cycle(zeros, word)
    # The host falls silent here on purpose. Without the next steps every valve would report that as a fault:
    # the set point deadline ends with OPERATIONAL, the heartbeat consumer is switched off.
    clients = driver.clients()
    driver.send([frames.nmt(NmtCommand.PRE_OPERATIONAL, node) for node, _ in clients])
    for node, client in clients:
        driver.send(driver.signs_of_life())
        with contextlib.suppress(SdoError):
            if driver.device.has_consumer:
                client.write(CONSUMER_HEARTBEAT, 1, 0, 4)
            if driver.device.is_guarded:
                client.write(LIFE_TIME_FACTOR, 0, 0, 1)
        driver.send([frames.nmt(NmtCommand.STOP, node)])
