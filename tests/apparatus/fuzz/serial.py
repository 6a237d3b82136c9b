"""Serial lines: answers of a device to the driver, and lines of a host to the devices."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from soro_hardware import load_platform
from soro_hardware.emulation.process import emulate
from soro_hardware.platform import PlatformBase
from soro_hardware.serial_line.line.channel import Channel
from soro_hardware.serial_line.line.engine import LineEngine
from soro_hardware.serial_line.line.request import LONGEST_LINE, Request
from tests.apparatus.faults.rigs import Rig, in_process
from tests.apparatus.fuzz.canopen import alive
from tests.apparatus.fuzz.pieces import Counted, Target, damaged

_ANSWERS = [
    b"0",
    b"512",
    b"1023",
    b"UNKNOWN COMMAND",
    b"OUT OF RANGE",
    b"?",
    b"B ?",
    b"A +014.70 +015.00",
    b"B +014.70 +015.00 MOV HLD",
    b"A +014.70 +015.00 14 kPaG",
    b"A   10v20.0-R24 Jan  9 2025,15:04:07",
    b"A D02 006 Gauge Press                s decimal     7/2 014 02 kPaG",
]
_ITV = [b"SET 512", b"SET 0", b"SET 1023", b"SET 99999", b"REQ", b"MON", b"INC", b"DEC", b"SET"]
_ALICAT = [
    b"A",
    b"BLS 40.00",
    b"CS40.00",
    b"ALSS S",
    b"B32000",
    b"CHP",
    b"CC",
    b"AVE",
    b"B??D*",
    b"A@ @",
    b"@@ A",
]


class Scripted:
    """A port whose other end is the fuzzer."""

    name = "fuzzer"

    def __init__(self) -> None:
        self.coming = b""

    def read(self) -> bytes:
        chunk, self.coming = self.coming, b""
        return chunk

    def write(self, data: bytes) -> None:
        pass

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        pass


def platform(family: str, firmware: str = "") -> PlatformBase:
    """The shipped platform, with another firmware."""
    found = load_platform({"itv_rs232": "itv_serial", "alicat": "alicat_serial"}[family])
    if not firmware:
        return found
    return found.model_copy(update={"emulation": found.emulation.model_copy(update={"firmware": firmware})})


def answers_to_the_driver(pieces: int, seed: int, family: str, firmware: str = "") -> Counted:
    """Every line is the answer to the one question that waits: good, or one more of garbled and refused."""
    rng, counted = random.Random(seed), Counted()
    rig = in_process(platform(family, firmware))
    driver: Any = rig.regulator
    make_lines, lines = driver.make_lines, list[LineEngine]()
    driver.make_lines = lambda ports: lines.extend(made := make_lines(ports)) or made
    driver.configure()
    line, port = lines[0], Scripted()
    plugged, line.port = line.port, port
    latches = [channel.latch for channel in line.channels]
    asked: deque[tuple[Channel, Request]] = deque(maxlen=1)
    for channel in line.channels:
        channel.latch = _nothing  # a device that is given up is hardly asked any more
        channel.next_request = partial(_noted, asked, channel, channel.next_request)
    now_ns = driver.now_ns()
    for _ in range(pieces):
        now_ns += 20_000_000
        rng.choice(line.channels).follow(rng.uniform(0.0, 90e3), 0.02)
        line.send(now_ns)
        messages = [_right(*asked[-1])] * 12 + _ANSWERS
        answer = damaged(rng, messages).translate(None, b"\r\n")[:LONGEST_LINE] or b"0"
        port.coming = answer + b"\r"
        before = line.counts.copy()
        line.receive(now_ns + 1)
        bad = sum(line.counts[kind] - before[kind] for kind in ("garbled", "refused", "late"))
        counted.sent += 1
        counted.bad += bad
        counted.good += line.counts["received"] - before["received"] - bad
        for channel in line.channels:
            if not channel.setpoint.low <= channel.setpoint.sent_counts <= channel.setpoint.high:
                raise AssertionError(f"{channel.setpoint.sent_counts} counts on the wire")
    for channel, latch in zip(line.channels, latches, strict=True):
        channel.latch = latch
    line.port = plugged
    driver.configure()
    alive(driver, 1)
    rig.close()
    return counted


def lines_to_the_devices(pieces: int, seed: int, family: str) -> Counted:
    """An ITV answers every line; Alicats those that begin with the letter of one."""
    rng, counted = random.Random(seed), Counted()
    known = platform(family)
    devices = emulate(known, True, seed)
    messages, highest = (_ITV, 100e3) if family == "itv_rs232" else (_ALICAT, 103.4e3)
    for _ in range(pieces):
        piece = damaged(rng, messages).translate(None, b"\r\n\x05\x16").strip()[:60] or messages[0]
        line = rng.choice(devices.lines)
        line.take(piece + b"\r\n")
        devices.now_ns += 150_000_000
        devices.work(devices.now_ns)
        counted.sent += 1
        answers = [row for row in bytes(line.output).splitlines() if row]
        line.output.clear()
        refused = any(row in (b"?", b"UNKNOWN COMMAND", b"OUT OF RANGE") for row in answers)
        counted.bad += refused
        counted.good += bool(answers) and not refused
        counted.untold += not answers and family == "alicat"
        for valve in devices.valves:
            demand = valve.demand_pa()
            if demand is not None and not -1e3 <= demand <= highest:
                raise AssertionError(f"a valve is asked for {demand} Pa")
    return counted


def bytes_between(pieces: int, seed: int, family: str) -> Counted:
    """Damage on the way in both directions, under a driver at work; one message in five is another."""
    rng, counted = random.Random(seed), Counted()
    rig = in_process(platform(family))
    driver: Any = rig.regulator
    driver.configure()
    _disturb(rig, rng, counted)
    cycle = 0
    while counted.sent < pieces:
        cycle += 1
        wanted = [rng.uniform(0.0, 90e3)] * driver.n_chambers
        sent = driver.exchange(wanted, cycle * 5_000_000).sent_pa
        if not (sent.min() >= 0.0 and sent.max() <= 90e3):
            raise AssertionError(f"{sent} on the wire")
        if driver.latched and cycle % 20 == 0:
            _calm(rig)
            driver.configure()
            _disturb(rig, rng, counted)
    _calm(rig)
    driver.configure()
    alive(driver, cycle + 1)
    rig.close()
    counted.untold = counted.sent
    return counted


def _noted(
    asked: deque[tuple[Channel, Request]], channel: Channel, ask: Callable[[int], Request], now_ns: int
) -> Request:
    """The next request of a channel, which `asked` remembers."""
    request = ask(now_ns)
    asked.append((channel, request))
    return request


def _right(channel: Any, request: Any) -> bytes:
    """What a device in order answers."""
    if not hasattr(channel, "unit"):
        return b"%d" % {"set": request.counts, "check": channel.setpoint.sent_counts}.get(request.kind, 400)
    units = b" 14 kPaG" if request.kind == "ls" else b""
    return b"%s +040.00 %+07.2f%s" % (channel.unit.encode(), channel.setpoint.sent_counts / 100, units)


def _disturb(rig: Rig, rng: random.Random, counted: Counted) -> None:
    def pass_on(chunk: bytes) -> bytes:
        if not chunk or rng.random() > 0.2:
            return chunk
        counted.sent += 1
        return damaged(rng, [chunk]).translate(None, b"\x05\x16")

    for line in rig.devices.lines:
        line.to_host = line.to_devices = pass_on


def _calm(rig: Rig) -> None:
    for line in rig.devices.lines:
        line.to_host = line.to_devices = bytes


def _nothing(code: str, message: str) -> None:
    return


def targets(family: str) -> dict[str, tuple[Target, float]]:
    """Targets of one dialect."""
    answers = partial(answers_to_the_driver, family=family)
    made: dict[str, tuple[Target, float]] = {"answers to the driver": (answers, 0.45)}
    if family == "alicat":
        made["answers to the driver, firmware 5"] = (partial(answers, firmware="5v12.0-R22"), 0.15)
    made["lines to the devices"] = (
        partial(lines_to_the_devices, family=family),
        0.53 if len(made) == 1 else 0.38,
    )
    made["damage on the way, both directions"] = (partial(bytes_between, family=family), 0.02)
    return made
