"""What must happen for every fault, stated beforehand; a family adds its rows to `MATRIX`.

*tolerate*: nothing happens but a count. *degrade*: it is reported, the arm goes on. *trip*: the whole arm
vents within the bound, the cause is named, and only a reset with a zero command ends it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from soro_core.hardware.emulation.faults import KINDS, Injection, read_injection

CHAMBER = "link0/chamber1"
# Bounds [ms]. A fault that the bus shows; one that a monitor finds after its 300 ms, once the circle has led
# 8 kPa away (at most 0.3 s); equal readings for 500 ms.
BUS_MS, AT_ONCE_MS, MODEL_MS, FROZEN_MS = 100.0, 10.0, 700.0, 900.0
# What shows only while the pressure falls has to wait for half a circle.
RISING_MS = 1000.0


@dataclass(frozen=True)
class Row:
    """What must happen.

    Attributes
    ----------
    fault : str
        YAML of the fault without `at`; several are separated by semicolons.
    must : str
        tolerate, degrade or trip.
    cause : str
        Regular expression that the cause of the trip matches.
    bound_ms : float
        Longest time from the injection to the vent command.
    blocked : bool
        Whether the fault itself keeps the air in its chamber.
    counts : str
        Field of `BusStatistics` that must have grown.
    motion : str
        Set points: on a circle, or held.
    bytes : bool
        Whether it acts on the bytes of a line, so that it takes a real one.
    """

    fault: str
    must: Literal["tolerate", "degrade", "trip"]
    cause: str = ""
    bound_ms: float = 0.0
    blocked: bool = False
    counts: str = ""
    motion: Literal["circle", "hold"] = "circle"
    bytes: bool = False

    def injections(self) -> list[Injection]:
        """The faults."""
        found = []
        for text in self.fault.split(";"):
            name = text.split(",")[0].strip()
            where = "" if KINDS[name].group == "bus" else f", chamber: {CHAMBER}"
            found.append(read_injection(f"fault: {text.strip()}{where}"))
        return found


# The air behind the valves is the same for every family, and so are the monitors.
_WRONG = rf"(implausible|stuck valve|frozen sensor): {CHAMBER} "
AIR = (
    Row("stuck_open", "trip", rf"(over-pressure|implausible): {CHAMBER} ", MODEL_MS, blocked=True),
    Row("stuck_closed", "trip", _WRONG, MODEL_MS, blocked=True),
    Row("stuck_at, pressure_pa: 30e3", "trip", _WRONG, MODEL_MS, blocked=True),
    # Vented by a set point of 0 that it follows as slowly, until its device is told to let go.
    Row("slow_valve, factor: 20", "trip", _WRONG, MODEL_MS, blocked=True),
    Row("slow_valve, factor: 1.3", "tolerate"),
    Row("leak, rate_1_s: 1.0", "tolerate"),
    Row("leak, rate_1_s: 20", "trip", _WRONG, MODEL_MS),
    Row("stuck_closed; leak, rate_1_s: 0.1", "trip", rf"leak: {CHAMBER} falls", 1800.0, True, motion="hold"),
    Row("burst", "trip", _WRONG, MODEL_MS),
    Row("kinked_line", "trip", _WRONG, MODEL_MS, blocked=True),
    Row("supply_drop, supply_pa: 20e3", "trip", _WRONG, MODEL_MS),
    Row("vent_blocked", "trip", _WRONG, RISING_MS + MODEL_MS, blocked=True),
    Row("setpoint_ignored", "trip", _WRONG, MODEL_MS, blocked=True),
    Row("sensor_offset, offset_pa: 15e3", "trip", _WRONG, MODEL_MS),
    Row("sensor_offset, offset_pa: 5e3", "tolerate"),
    Row("sensor_scale, factor: 1.5", "trip", _WRONG, 2 * MODEL_MS),
    Row("sensor_scale, factor: 1.05", "tolerate"),
    Row("sensor_noise, sigma_pa: 1e3", "tolerate"),
    Row("sensor_noise, sigma_pa: 40e3", "trip", rf"(spike|over-pressure|short circuit): {CHAMBER} ", BUS_MS),
    Row("sensor_stuck", "trip", rf"frozen sensor: {CHAMBER} ", FROZEN_MS),
    Row("sensor_saturate, most_pa: 20e3", "trip", _WRONG, 2 * MODEL_MS),
    Row("sensor_quantise, step_pa: 2e3", "tolerate"),
)
# A reading that no pressure explains, where the device can express it; else it reads as the end of its range.
OPEN_CIRCUIT = (
    Row("sensor_open_circuit", "trip", f"open circuit: {CHAMBER} ", AT_ONCE_MS),
    Row("sensor_open_circuit, reading_pa: 160e3", "trip", f"short circuit: {CHAMBER} ", AT_ONCE_MS),
)
CLIPPED = (
    Row("sensor_open_circuit", "trip", rf"(open circuit|spike): {CHAMBER} ", BUS_MS),
    Row(
        "sensor_open_circuit, reading_pa: 160e3",
        "trip",
        r"(short circuit|spike|over-pressure|out of)",
        BUS_MS,
    ),
)
# Of every line; what its bytes do beside that is the family's own.
LINE = (Row("adapter_unplug", "trip", "(gone|link_lost|closed)", BUS_MS, bytes=True),)
_NODE = rf"{CHAMBER} \(node 2\)"
CANOPEN = (
    Row("drop, p: 0.02", "tolerate", counts="frames_lost"),
    Row("drop, p: 0.95", "trip", "stale_reading", BUS_MS, counts="frames_lost"),
    Row("corrupt_bits, p: 0.05", "degrade", counts="bus_errors"),
    Row("corrupt_bits, p: 1.0", "trip", "bus_off: bus", AT_ONCE_MS, counts="bus_errors"),
    Row("truncate, p: 0.005", "tolerate", counts="frames_garbled", bytes=True),
    Row("truncate, p: 0.9", "trip", "(stale_reading|emergency)", BUS_MS, bytes=True),
    Row("garbage_line, p: 0.1", "tolerate", counts="frames_garbled", bytes=True),
    Row("duplicate, p: 0.3", "tolerate"),
    Row("delay, delay_s: 0.02", "tolerate"),
    Row("delay, delay_s: 0.2", "trip", "stale_reading", BUS_MS, counts="frames_lost"),
    Row("reorder, p: 0.05", "tolerate"),
    Row("bus_off", "trip", "bus_off: bus: the adapter is off the bus", AT_ONCE_MS),
    Row("ack_missing", "trip", "stale_reading", BUS_MS, counts="frames_lost"),
    Row("babble, can_id: 0", "trip", "stale_reading", BUS_MS, counts="frames_lost"),
    Row("babble, can_id: 2047", "tolerate"),
    Row("adapter_unplug", "trip", "gone", AT_ONCE_MS),
    Row("reboot", "trip", f"rebooted: {_NODE}", AT_ONCE_MS),
    Row("brownout, duration_s: 0.05", "trip", f"emergency: {_NODE}: emergency 0x3120", AT_ONCE_MS),
    Row("mute", "trip", f"stale_reading: {_NODE}", BUS_MS),
    Row("freeze_tpdo", "trip", rf"frozen sensor: {CHAMBER} ", FROZEN_MS),
    Row("wrong_node_id, node: 99", "trip", f"stale_reading: {_NODE}", BUS_MS),
    # Nothing of the loop goes by SDO; what they do at the start-up is another test.
    Row("sdo_abort", "tolerate"),
    Row("sdo_timeout", "tolerate"),
)
# A connection loses nothing by itself; what its ends lose or damage shows in the frames, which have a CRC.
BOARD = (
    Row("drop, p: 0.02", "tolerate", counts="frames_lost", bytes=True),
    Row("corrupt_bits, p: 0.02", "tolerate", counts="frames_lost", bytes=True),
    Row("truncate, p: 0.02", "tolerate", counts="frames_lost", bytes=True),
    Row("garbage_line, p: 0.1", "tolerate", counts="frames_garbled", bytes=True),
    Row("duplicate, p: 0.3", "tolerate", counts="frames_refused", bytes=True),
    Row("reboot", "trip", "(link_lost|rebooted)", AT_ONCE_MS, bytes=True),
    Row("brownout, duration_s: 0.05", "trip", "(device_error|rebooted): board: .*port 1", BUS_MS, bytes=True),
    Row("mute", "trip", "(stale_reading|heartbeat_lost)", BUS_MS, bytes=True),
)
# A cable that is out, or a byte too few or many, ends the published server, which then holds every pressure:
# the tests of the family show what its driver makes of that.
VEAB = (Row("mute", "trip", "stale_reading", BUS_MS, bytes=True),)
MATRIX: dict[str, tuple[Row, ...]] = {
    "canopen_408": (*CANOPEN, *AIR, *OPEN_CIRCUIT),
    "itv_rs232": (*LINE, *AIR, *CLIPPED),
    "alicat": (*LINE, *AIR, *CLIPPED),
    "veab_tcp": (*VEAB, *AIR, *CLIPPED),
    "soro_board": (*BOARD, *LINE, *AIR, *CLIPPED),
}
