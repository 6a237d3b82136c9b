"""One row of the fault matrix: a fault and what must happen; the rows themselves are in `matrix`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from soro_hardware.emulation.faults.fault_types import KINDS, OF_ALL, Injection, read_injection

CHAMBER = "link0/chamber1"


@dataclass(frozen=True)
class Row:
    """What must happen.

    Attributes
    ----------
    fault : str
        YAML of the fault without `at`; several are separated by semicolons.
    must : str
        *tolerate*: nothing happens but a count. *degrade*: it is reported or slower, the arm goes on. *trip*:
        the whole arm vents within the bound, the cause is named, only a reset with a zero command ends it.
    cause : str
        Regular expression that the cause of the trip matches.
    bound_ms : float
        Longest time from the injection to the vent command.
    blocked : str
        Where the fault itself keeps the air in: nowhere, in its chamber, or in the whole arm.
    slower : float
        Factor by which the fault lengthens the vent of its chamber.
    late_s : float
        Time by which the fault holds up the messages of the vent.
    counts : str
        Field of `BusStatistics` that must have grown.
    motion : str
        Set points: on a circle, or held.
    bytes : bool
        Whether it needs the bytes of a real line, where the family's rig has none.
    """

    fault: str
    must: Literal["tolerate", "degrade", "trip"]
    cause: str = ""
    bound_ms: float = 0.0
    blocked: Literal["", "chamber", "arm"] = ""
    slower: float = 1.0
    late_s: float = 0.0
    counts: str = ""
    motion: Literal["circle", "hold"] = "circle"
    bytes: bool = False

    def injections(self) -> list[Injection]:
        """The faults."""
        found = []
        for text in self.fault.split(";"):
            name = text.split(",")[0].strip()
            where = "" if KINDS[name].group in OF_ALL else f", chamber: {CHAMBER}"
            found.append(read_injection(f"fault: {text.strip()}{where}"))
        return found
