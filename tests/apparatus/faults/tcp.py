"""Rows of the families over TCP: their connection, their devices."""

from __future__ import annotations

from tests.apparatus.faults.bounds import AT_ONCE_MS, FROZEN_MS, HIGH, IGNORED, MODEL_MS, MOTION_MS, WRONG
from tests.apparatus.faults.rows import Row

# Written over within a cycle.
ANOTHER = "set_by_another, pressure_pa: 60e3"


def veab(own: float) -> tuple[Row, ...]:
    """A published server that ends at the first error, and then holds every pressure.

    Its messages have neither a frame nor a checksum; what TCP's own does not find is a wrong pressure.
    """
    ended = "(link_lost|out_of_sync)"
    return (
        Row("drop, p: 0.02", "tolerate", counts="frames_lost"),
        Row(
            "corrupt_bits, p: 0.3", "trip", f"({ended}|spike|over-pressure|short circuit)", own, blocked="arm"
        ),
        Row("truncate, p: 0.3", "trip", ended, own, blocked="arm"),
        Row("garbage_line, p: 0.3", "trip", ended, own, blocked="arm"),
        Row("duplicate, p: 0.3", "tolerate"),
        Row("delay, delay_s: 0.02", "tolerate"),
        Row("reorder, p: 0.05", "tolerate"),
        Row("adapter_unplug", "trip", "link_lost", AT_ONCE_MS, blocked="arm"),
        Row("reboot", "trip", "link_lost", AT_ONCE_MS, blocked="arm"),
        Row("mute", "trip", "stale_reading", own),
        Row(IGNORED, "trip", WRONG, MOTION_MS + MODEL_MS + own, blocked="chamber"),
        Row(ANOTHER, "tolerate"),
    )


def board(own: float) -> tuple[Row, ...]:
    """A connection loses nothing by itself; what its ends lose or damage is seen by the CRC of the frames."""
    return (
        Row("drop, p: 0.02", "tolerate", counts="frames_lost"),
        Row("drop, p: 0.95", "trip", "(stale_reading|heartbeat_lost)", own, counts="frames_lost"),
        Row("corrupt_bits, p: 0.02", "tolerate", counts="frames_lost"),
        Row("corrupt_bits, p: 1.0", "trip", "(stale_reading|heartbeat_lost)", own, counts="frames_lost"),
        Row("truncate, p: 0.02", "tolerate", counts="frames_lost"),
        Row("garbage_line, p: 0.1", "tolerate", counts="frames_garbled"),
        Row("duplicate, p: 0.3", "tolerate", counts="frames_refused"),
        Row("delay, delay_s: 0.02", "tolerate", counts="frames_lost"),
        Row("delay, delay_s: 0.2", "trip", "(stale_reading|watchdog_vented)", own),
        Row("reorder, p: 0.05", "tolerate"),
        Row("adapter_unplug", "trip", "link_lost", AT_ONCE_MS),
        Row("reboot", "trip", "(link_lost|rebooted)", AT_ONCE_MS),
        Row("brownout, duration_s: 0.05", "trip", "(device_error|rebooted): board: .*port 1", own),
        Row("mute", "trip", "(stale_reading|heartbeat_lost)", own),
        Row(IGNORED, "trip", WRONG, MOTION_MS + MODEL_MS + own, blocked="chamber"),
        Row(ANOTHER, "tolerate"),
    )


def vtem(own: float) -> tuple[Row, ...]:
    """Two requests a cycle without a checksum of their own, and a device that keeps what it has.

    A slot whose app has ended keeps its pressure, in both of its chambers; so nothing is said of when the arm
    is empty where slots are lost, or where it cannot be heard what they are told.
    """
    slot = r"link0/chamber0, link0/chamber1 \(slot 0\)"
    # In a request a wrong bit is another address, command or set point, in an answer a state or a reading.
    wrong = f"(command_rejected|left_operational|device_error|stale_reading|{WRONG}|{HIGH}|open circuit)"
    return (
        Row("drop, p: 0.02", "tolerate", counts="frames_lost"),
        Row("drop, p: 0.95", "trip", "stale_reading", own, blocked="arm", counts="frames_lost"),
        Row("corrupt_bits, p: 0.3", "trip", wrong, own, blocked="arm"),
        Row("truncate, p: 0.9", "trip", wrong, own, blocked="arm"),
        Row("garbage_line, p: 0.02", "tolerate", counts="frames_garbled"),
        Row("duplicate, p: 0.3", "tolerate", counts="frames_late"),
        # Longer than a cycle has: every answer is late, and the vent by as much.
        Row("delay, delay_s: 0.02", "trip", "stale_reading", own, late_s=0.02, counts="frames_lost"),
        Row("reorder, p: 0.05", "tolerate", counts="frames_lost"),
        Row("adapter_unplug", "trip", "link_lost", AT_ONCE_MS, blocked="arm"),
        Row("reboot", "trip", "(link_lost|rebooted)", AT_ONCE_MS, blocked="arm"),
        Row(
            "brownout, duration_s: 0.3", "trip", f"device_error: {slot}: .*failure", AT_ONCE_MS, blocked="arm"
        ),
        Row("mute", "trip", "stale_reading", own),
        Row(
            "freeze_tpdo",
            "trip",
            r"(frozen sensor|implausible|stuck valve): link0/chamber[01] ",
            MOTION_MS + FROZEN_MS + own,
        ),
        Row(IGNORED, "trip", WRONG, MOTION_MS + MODEL_MS + own, blocked="chamber"),
        Row(ANOTHER, "tolerate"),
    )
