"""State machine of a valve (CiA 408) over SDO, in the start-up; a device without one is left as it is."""

from __future__ import annotations

from soro_hardware.canopen import cia408
from soro_hardware.canopen.cia408 import Control, ValveState
from soro_hardware.canopen.device import Device
from soro_hardware.canopen.sdo_client import SdoClient


def to_hold(sdo: SdoClient, device: Device, channel: int, timeout_s: float) -> None:
    """Bring a valve to HOLD after NMT start, where it follows the hold set point 0.

    Parameters
    ----------
    sdo : SdoClient
        Client of the node.
    device : Device
        Kind of device.
    channel : int
        Number of the valve in the node.
    timeout_s : float
        Longest time for each state [s].
    """
    sdo.step = "state machine to hold"
    if device.has_states:
        for control, state in (
            (Control.INIT, ValveState.INIT),
            (Control.DISABLED, ValveState.DISABLED),
            (Control.HOLD, ValveState.HOLD),
        ):
            _command(sdo, device, channel, control, state, timeout_s)


def to_init(sdo: SdoClient, device: Device, channel: int, timeout_s: float) -> None:
    """Bring a valve to INIT, where parameters can be set; parameters as in `to_hold`.

    Edges of bit 3 of the control word reset a fault.
    """
    sdo.step = "state machine to init"
    if device.has_states and _status(sdo, device, channel) & 0xF != ValveState.INIT.bits:
        _command(sdo, device, channel, Control.INIT, ValveState.INIT, timeout_s)


def _status(sdo: SdoClient, device: Device, channel: int) -> int:
    status = device.require("status", channel)
    return sdo.read(status.index, status.sub)


def _command(
    sdo: SdoClient, device: Device, channel: int, control: Control, state: ValveState, timeout_s: float
) -> None:
    """Write a control word until the status word shows the state, which may take some cycles."""
    word = device.require("control", channel)
    expired = sdo.timer(timeout_s)
    while True:
        sdo.write(word.index, word.sub, control, word.size)
        status = _status(sdo, device, channel)
        if status & 0xF == state.bits:
            return
        found = cia408.state_of(status)
        if expired():
            raise sdo.error(
                f"control word {control:d} does not lead to {state.value[0]}, found {found.value[0]}"
            )
        if found.is_fault and control is Control.INIT:
            sdo.write(word.index, word.sub, Control.RESET, word.size)
