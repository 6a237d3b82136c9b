"""Fuzzing: a million pieces a family, valid traffic with damage and noise, in both directions."""

from __future__ import annotations

import threading
import time

from benchmarks.options import Options
from benchmarks.report import met, table
from tests.apparatus.fuzz import boards, canopen, modbus, serial
from tests.apparatus.fuzz.pieces import Counted, Target

TITLE = "Fuzzing"
PIECES = 1_000_000
FAMILIES: dict[str, dict[str, tuple[Target, float]]] = {
    "canopen_408": canopen.TARGETS,
    "itv_rs232": serial.targets("itv_rs232"),
    "alicat": serial.targets("alicat"),
    "veab_tcp": boards.targets("veab_tcp"),
    "soro_board": boards.targets("soro_board"),
    "vtem_modbus": modbus.TARGETS,
}


def run(options: Options) -> str:
    """Send everything, and write."""
    total = options.pick(PIECES, 500)
    rows: list[list[object]] = []
    for family in FAMILIES:
        start = time.perf_counter()
        for name in FAMILIES[family]:
            options.say(f"{family}: {name}")
            rows.append(_row(family, name, total))
        took = time.perf_counter() - start
        options.say(f"{family}: {took:.0f} s")
    head = ("family", "what, to whom", "pieces", "good", "bad, counted", "untold", "not counted", "target")
    return (
        f"{total} pieces a family: three in four are valid messages, most of them with one to three bytes "
        "changed, lost, doubled or cut, the others are noise; seeded. *Untold*: the protocol does not let "
        "anybody know (a line for no unit, an empty piece, a stream without frames or checksums). All pieces "
        "are untold where the fuzzer does not see what becomes of one: damage on the way, where a piece may "
        "spoil several messages or none, and bytes to the server over TCP, which come in other pieces than "
        "they were sent; there the counts say nothing, the rest of what follows does. Met: no "
        "exception, no thread that has ended, every set point and valve in its range, a driver in order "
        "afterwards where there is one, and nothing that is not counted.\n\n" + table(head, rows)
    )


def fuzz(family: str, name: str, total: int, seed: int = 408) -> Counted:
    """Send a target's part of `total` pieces.

    Raises
    ------
    AssertionError
        If something else than a count has changed, or a thread has died.
    """
    target, part = FAMILIES[family][name]
    died: list[str] = []
    hook, threading.excepthook = threading.excepthook, lambda args: died.append(str(args.exc_value))
    try:
        counted = target(max(round(part * total), 1), seed)
    finally:
        threading.excepthook = hook
    if died:
        raise AssertionError(f"{family}: {name}: a thread has ended: {died[0]}")
    return counted


def _row(family: str, name: str, total: int) -> list[object]:
    try:
        found = fuzz(family, name, total)
    except Exception as error:
        return [family, name, "-", "-", "-", "-", f"{type(error).__name__}: {error}", met(False)]
    counts = [found.sent, found.good, found.bad, found.untold, found.missing]
    return [family, name, *counts, met(found.missing == 0)]
