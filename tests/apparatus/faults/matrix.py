"""What must happen for every fault on every family, stated beforehand.

The bound of a trip is the family's own, from the moment at which the fault can be known: 100 ms for CANopen,
our board and the VTEM, 150 ms for the published VEAB server. A serial line says nothing of itself and its
answers come one after another, so there it is the age at which the driver knows a reading to be lost, and a
round of the line. Where a monitor must see that a reading is wrong, its own time (docs/safety.md: 300 ms
against the model, 500 ms for equal readings) and the motion that shows it come before that.
"""

from __future__ import annotations

from tests.apparatus.faults.bounds import (
    AT_ONCE_MS,
    DRIFT_MS,
    FAMILY_MS,
    FOUR,
    FROZEN_MS,
    GROWTH_MS,
    HIGH,
    IGNORED,
    MODEL_MS,
    MOTION_MS,
    SLOW,
    SUPPLY_EVENT_MS,
    SUPPLY_MS,
    TOP_MS,
    WRONG,
)
from tests.apparatus.faults.rows import CHAMBER, Row
from tests.apparatus.faults.tcp import board, veab, vtem


def _supply(family: str, model_ms: float) -> Row:
    """Where the devices report their supply it names itself; else a chamber shows that it is not filled."""
    fault = "supply_drop, supply_pa: 20e3"
    if not family.startswith("canopen"):
        return Row(fault, "trip", WRONG, model_ms)
    return Row(
        fault, "trip", r"supply low: link\d/chamber\d ", SUPPLY_EVENT_MS + SUPPLY_MS + FAMILY_MS[family]
    )


def _stop(family: str, model_ms: float) -> tuple[Row, ...]:
    """The dump valve opens all chambers; the regulators feed them, and the monitors see it."""
    empties = r"(implausible|stuck valve|frozen sensor|spike): link0/chamber\d "
    pressed = Row("stop_pressed", "trip", empties, model_ms)
    if family == "soro_board":  # reads the contact
        pressed = Row("stop_pressed", "trip", "stop_pressed: board: ", FAMILY_MS[family])
    return (
        pressed,
        Row("dump_valve_open", "trip", empties, model_ms),
        Row("dump_valve_stuck", "tolerate"),
    )


def air(family: str, narrow: float = 20.0, leak: float = 20.0) -> tuple[Row, ...]:
    """Rows of valves, chambers and sensors: the air is the same for every family, and so are the monitors.

    `narrow` is the factor by which what is narrow lets less through, `leak` the rate of a leak [1/s]: the
    flow of a healthy valve can do more than the circle asks for, and hides smaller ones for longer.
    """
    own = FAMILY_MS[family]
    model, frozen = MOTION_MS + MODEL_MS + own, MOTION_MS + FROZEN_MS + own
    # Slow readings see a chamber jump that fast ones see rise.
    rises = rf"(over-pressure|implausible{'|spike' if family in SLOW else ''}): {CHAMBER} "
    return (
        Row("stuck_open", "trip", rises, model, blocked="chamber"),
        Row("stuck_closed", "trip", WRONG, model, blocked="chamber"),
        Row("stuck_at, pressure_pa: 30e3", "trip", WRONG, model, blocked="chamber"),
        # Vented by a set point of 0, which such a valve follows as slowly as any other.
        Row(f"slow_valve, factor: {narrow:g}", "trip", WRONG, model, slower=narrow),
        Row("slow_valve, factor: 1.3", "tolerate"),
        Row("leak, rate_1_s: 1.0", "tolerate"),
        Row(f"leak, rate_1_s: {leak:g}", "trip", WRONG, model),
        Row(
            "stuck_closed; leak, rate_1_s: 0.1",
            "trip",
            rf"leak: {CHAMBER} falls",
            DRIFT_MS + own,
            blocked="chamber",
            motion="hold",
        ),
        Row("burst", "trip", WRONG, model),
        Row(f"kinked_line, factor: {narrow:g}", "trip", WRONG, model, slower=narrow),
        _supply(family, model),
        *_stop(family, model),
        Row("vent_blocked", "trip", WRONG, TOP_MS + model, blocked="chamber"),
        Row("sensor_offset, offset_pa: 15e3", "trip", WRONG, model),
        Row("sensor_offset, offset_pa: 5e3", "tolerate"),
        Row("sensor_scale, factor: 1.5", "trip", WRONG, GROWTH_MS + model),
        Row("sensor_scale, factor: 1.05", "tolerate"),
        Row("sensor_noise, sigma_pa: 1e3", "tolerate"),
        # One reading in three jumps by more than 50 kPa: ten of them are within every family's bound.
        Row("sensor_noise, sigma_pa: 40e3", "trip", HIGH, own),
        Row("sensor_stuck", "trip", rf"frozen sensor: {CHAMBER} ", frozen),
        Row("sensor_saturate, most_pa: 20e3", "trip", WRONG, GROWTH_MS + model),
        Row("sensor_quantise, step_pa: 2e3", "tolerate"),
    )


def _broken_wire(at_once: bool, own_ms: float) -> tuple[Row, ...]:
    """A reading that no pressure explains, where the device can express it; else the end of its range."""
    low = "open circuit" if at_once else "(open circuit|spike|sensor_failed)"
    high = "short circuit" if at_once else "(short circuit|spike|over-pressure)"
    bound_ms = AT_ONCE_MS if at_once else own_ms
    return (
        Row("sensor_open_circuit", "trip", rf"{low}: {CHAMBER} ", bound_ms),
        Row("sensor_open_circuit, reading_pa: 160e3", "trip", rf"{high}: {CHAMBER} ", bound_ms),
    )


def _canopen(own: float) -> tuple[Row, ...]:
    node = rf"(link./chamber., )*{CHAMBER}(, link./chamber.)* \(node \d( channel \d)?\)"
    return (
        Row("drop, p: 0.02", "tolerate", counts="frames_lost"),
        Row("drop, p: 0.95", "trip", "stale_reading", own, counts="frames_lost"),
        Row("corrupt_bits, p: 0.05", "degrade", counts="bus_errors"),
        Row("corrupt_bits, p: 1.0", "trip", "bus_off: bus", AT_ONCE_MS, counts="bus_errors"),
        Row("truncate, p: 0.005", "tolerate", counts="frames_garbled", bytes=True),
        Row("truncate, p: 0.9", "trip", "(stale_reading|emergency)", own, bytes=True),
        Row("garbage_line, p: 0.1", "tolerate", counts="frames_garbled", bytes=True),
        Row("duplicate, p: 0.3", "tolerate"),
        # Both ways 40 ms, less than the 50 ms that a reading may be old: as many answers are missing, once.
        Row("delay, delay_s: 0.02", "tolerate", counts="frames_lost"),
        Row("delay, delay_s: 0.2", "trip", "stale_reading", own, counts="frames_lost"),
        Row("reorder, p: 0.05", "tolerate"),
        Row("bus_off", "trip", "bus_off: bus: the adapter is off the bus", AT_ONCE_MS),
        Row("ack_missing", "trip", "stale_reading", own, counts="frames_lost"),
        Row("babble, can_id: 0", "trip", "stale_reading", own, counts="frames_lost"),
        Row("babble, can_id: 2047", "tolerate"),
        Row("adapter_unplug", "trip", "gone", AT_ONCE_MS),
        Row("reboot", "trip", f"rebooted: {node}", AT_ONCE_MS),
        Row(
            "supply_rise, supply_pa: 1.2e6",
            "trip",
            f"supply high: {CHAMBER} has 1200.0 kPa, allowed 1100.0 kPa",
            SUPPLY_EVENT_MS + SUPPLY_MS + own,
        ),
        Row("overheat", "trip", f"over_temperature: {node}", SUPPLY_EVENT_MS + own),
        Row("overheat, celsius: 60", "tolerate"),
        Row("brownout, duration_s: 0.05", "trip", f"emergency: {node}: emergency 0x3120", AT_ONCE_MS),
        Row("mute", "trip", f"stale_reading: {node}", own),
        Row("freeze_tpdo", "trip", rf"frozen sensor: {CHAMBER} ", MOTION_MS + FROZEN_MS + own),
        Row("wrong_node_id, node: 99", "trip", f"stale_reading: {node}", own),
        # Nothing of the loop goes by SDO; what they do at the start-up is another test.
        Row("sdo_abort", "tolerate"),
        Row("sdo_timeout", "tolerate"),
        # The next set point of the bus comes within a cycle.
        Row("set_by_another, pressure_pa: 60e3", "tolerate"),
        Row(IGNORED, "trip", WRONG, MOTION_MS + MODEL_MS + own, blocked="chamber"),
    )


_LOST = "(readings lost|device_silent)"


def _late(family: str, own: float) -> tuple[Row, ...]:
    """A question waits for its answer; with 20 ms on both ways it takes 40 ms more, and the arm has fewer."""
    if family == "itv_rs232":
        return (Row("delay, delay_s: 0.02", "degrade"),)
    # Three units share the line: the six questions of a round then take 0.27 s, too long for a reading.
    late = Row("delay, delay_s: 0.02", "trip", _LOST, own, late_s=3 * 0.045)
    return (Row("delay, delay_s: 0.005", "degrade"), late)


def _serial(family: str, own: float) -> tuple[Row, ...]:
    """Lines without a checksum: a wrong digit lasts one reading, a wrong set point until its echo."""
    device, lost = rf"{CHAMBER} \((unit B on )?\S+\)", f"readings lost: {CHAMBER}"
    return (
        Row("drop, p: 0.02", "tolerate", counts="frames_lost"),
        # What the devices cannot hear they cannot obey, and they have no watchdog.
        Row("drop, p: 0.95", "trip", _LOST, own, blocked="arm", counts="frames_lost"),
        Row("corrupt_bits, p: 0.02", "tolerate", counts="frames_garbled"),
        Row("truncate, p: 0.02", "tolerate", counts="frames_lost"),
        Row("garbage_line, p: 0.02", "tolerate", counts="frames_garbled"),
        Row("duplicate, p: 0.05", "tolerate", counts="frames_late"),
        *_late(family, own),
        # The vent waits for its turn, 60 ms for each question that is given up, and is late itself.
        Row(
            "delay, delay_s: 0.2",
            "trip",
            _LOST,
            own,
            late_s=0.2 + (0.07 if family == "itv_rs232" else 3 * 0.061),
            counts="frames_lost",
        ),
        Row("reorder, p: 0.02", "tolerate"),
        # Ports are gone with their adapters, and the devices hold what they have.
        Row("adapter_unplug", "trip", "the port is gone", AT_ONCE_MS, blocked="arm"),
        # Silent for 0.1 s; then three times another set point than it had confirmed.
        Row("reboot", "trip", f"(rebooted: {device}|{lost})", 100.0 + own),
        Row("brownout, duration_s: 0.3", "trip", f"(device_silent: {device}|{lost})", own),
        Row("mute", "trip", f"(device_silent: {device}|{lost})", own),
        # Shown by the next answer to a question for it; a chamber that moves is sent another one before.
        Row(
            "set_by_another, pressure_pa: 60e3",
            "trip",
            f"(rebooted|setpoint_ignored): {device}",
            own if family == "alicat" else 200.0 + own,
            motion="hold",
        ),
        # An Alicat shows the set point that it has in every answer, an ITV is asked for it every 0.2 s.
        Row(
            IGNORED,
            "trip",
            rf"(setpoint_ignored|rebooted): {device}",
            own if family == "alicat" else 200.0 + own,
            blocked="chamber",
        ),
    )


def _alicat_heat(own: float) -> Row:
    """A flag in the answers, without a number."""
    return Row("overheat", "trip", rf"over_temperature: {CHAMBER} ", own)


def _itv_wire(own: float) -> tuple[Row, ...]:
    """Ten bits from 0 to full scale: an open wire reads 0 kPa, which nothing but the model contradicts."""
    _, high = _broken_wire(False, own)
    return (Row("sensor_open_circuit", "trip", rf"(spike|frozen sensor): {CHAMBER} ", MODEL_MS + own), high)


_OWN = FAMILY_MS
_OF_FOUR = ("drop", "bus_off", "reboot", "mute", "stuck_open", "stuck_closed", "burst", "sensor_stuck")
MATRIX: dict[str, tuple[Row, ...]] = {
    "canopen_408": (
        *_canopen(_OWN["canopen_408"]),
        *air("canopen_408"),
        *_broken_wire(True, _OWN["canopen_408"]),
    ),
    # The same driver at 500 Hz, where a node is four chambers.
    FOUR: tuple(
        row
        for row in (*_canopen(_OWN[FOUR]), *air(FOUR), *_broken_wire(True, _OWN[FOUR]))
        if row.fault.split(",")[0] in _OF_FOUR
    ),
    "itv_rs232": (
        *_serial("itv_rs232", _OWN["itv_rs232"]),
        *air("itv_rs232"),
        *_itv_wire(_OWN["itv_rs232"]),
    ),
    "alicat": (
        *_serial("alicat", _OWN["alicat"]),
        _alicat_heat(_OWN["alicat"]),
        *air("alicat"),
        *_broken_wire(False, _OWN["alicat"]),
    ),
    "veab_tcp": (*veab(_OWN["veab_tcp"]), *air("veab_tcp"), *_broken_wire(False, _OWN["veab_tcp"])),
    "soro_board": (
        *board(_OWN["soro_board"]),
        *air("soro_board"),
        *_broken_wire(False, _OWN["soro_board"]),
    ),
    "vtem_modbus": (
        *vtem(_OWN["vtem_modbus"]),
        *air("vtem_modbus"),
        *_broken_wire(True, _OWN["vtem_modbus"]),
    ),
}
