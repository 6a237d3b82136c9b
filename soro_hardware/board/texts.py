"""Texts and fault codes for the codes of the board."""

from __future__ import annotations

from soro_hardware.board import frames
from soro_hardware.board.messages import Cause, PortFlag, Refusal, StateMessage

CAUSES = {
    Cause.WATCHDOG: ("watchdog_vented", "has vented: no set point came in time"),
    Cause.HOST_GONE: ("watchdog_vented", "has vented: the connection of its host ended"),
    Cause.DEVICE_ERROR: ("device_error", "has vented: a chip does not answer"),
    Cause.CHIP_RESET: ("rebooted", "has vented: a chip has been without power"),
    Cause.SELF_TEST: ("device_error", "has failed its self-test"),
    Cause.STOPPING: ("left_operational", "has been stopped"),
    Cause.STOP_CONTACT: (
        "stop_pressed",
        "has vented: the contact of the emergency stop is open (pressed, or a broken wire)",
    ),
}
_REFUSALS: dict[int, str] = {
    Refusal.BUSY: "serves another host",
    Refusal.PORTS: "has another number of ports than the platform file",
    Refusal.RANGE: "refuses a set point as out of its range",
    Refusal.OLD: "refuses a set point as older than the last",
    Refusal.NO_HELLO: "does not know this host",
    Refusal.STRANGER: "does not admit this host: board.hosts in the platform file on the Pi",
    Refusal.NUMBER: "has welcomed this host with another number",
    Refusal.VERSION: f"speaks frames of another version than this driver, {frames.VERSION}",
}
_ADVICE: dict[int, str] = {
    Refusal.BUSY: "end the other driver; the board drops a silent host after a second",
    Refusal.VERSION: "install the same version of soro on both sides",
    Refusal.STRANGER: "add this host's address to board.hosts there, and start `soro board` again",
}
SILENT = f"does not answer HELLO: `soro board` of another version than frames {frames.VERSION}, or no board"
_FLAGS = {
    PortFlag.DAC_ERROR: "DAC does not answer",
    PortFlag.ADC_ERROR: "ADC does not answer",
    PortFlag.OUT_OF_RANGE: "voltage beyond the ADC's range",
    PortFlag.CHIP_RESET: "a chip has been without power",
}


def refusal(code: int) -> str:
    """Return the reason of a refusal, as continuation of "the board"."""
    return _REFUSALS.get(code, f"refuses with code {code}")


def advice(code: int) -> str:
    """Return the advice for a refusal."""
    return _ADVICE.get(code, "use the same platform file and the same version of soro on both sides")


def complaints(state: StateMessage) -> str:
    """Return the errors of the board's ports in brackets, empty for none."""
    found = [
        f"port {number}: {text}"
        for number, port in enumerate(state.ports)
        for flag, text in _FLAGS.items()
        if port.flags & flag
    ]
    return f" ({', '.join(found)})" if found else ""
