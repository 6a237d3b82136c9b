"""Exact frames, and bytes on the line, of start-up, a cycle, a fault, its reset, a vent and the shutdown."""

import numpy as np
import pytest
from hardware_bench import (
    ONE_VALVE,
    Bench,
    EmulatorProcess,
    Tap,
    emulator,
    platform_file,
    single,
    transcript,
)

from soro_hardware import open_regulator
from soro_hardware.canopen.cia408 import ValveState
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.slcan_codec import encode

# Closed twice, 1 Mbit/s, no time stamps, frames as they come, a filter that lets all through, open.
SLCAN_OPENS = b"C\rC\rS8\rZ0\rX1\rM00000000\rmFFFFFFFF\rO\r"
QUIET = {"regulator": {"reading_noise_pa": 0.0}}


@pytest.fixture
def bench():
    bench = Bench(single(**QUIET))
    bench.driver.configure()
    return bench


def test_start_up(bench):
    assert bench.bus.take_log() == transcript("start_up")


def test_cycle(bench):
    bench.bus.take_log()
    bench.run(2, 20e3)
    assert bench.bus.take_log() == transcript("cycle")


def test_fault_and_reset(bench):
    bench.run(12, 20e3)
    bench.bus.take_log()
    bench.world.nodes[0].fault(0x8302, 1, ValveState.FAULT_HOLD)
    bench.run(3, 20e3)
    assert bench.bus.take_log() == transcript("fault")
    bench.driver.configure()
    log, reset = bench.bus.take_log(), transcript("reset")
    assert log[: len(reset)] == reset
    start_up = transcript("start_up")
    assert (
        log[len(reset) : len(reset) + 20]
        == start_up[start_up.index("> 601 [8] 2B 17 10 00 19 00 00 00") :][:20]
    )


def test_vent(bench):
    bench.run(3, 60e3)
    bench.bus.take_log()
    bench.driver.vent()
    bench.driver.vent()
    assert bench.bus.take_log() == transcript("vent")


def test_shutdown(bench):
    bench.run(3, 3e3)
    bench.bus.take_log()
    bench.driver.close()
    assert bench.bus.take_log() == transcript("shutdown")


def _line(entry: str) -> bytes:
    """A transcript's frame as LAWICEL bytes."""
    _, identifier, _, *data = entry.split()
    return encode(Frame(int(identifier, 16), bytes.fromhex("".join(data))))


@pytest.mark.process
def test_bytes_over_a_pseudo_terminal(tmp_path):
    """The same transcripts as bytes, between this process and the emulator's."""
    path = platform_file(tmp_path, valves=ONE_VALVE, **QUIET)
    log = [*transcript("start_up"), *transcript("cycle")]
    with emulator(tmp_path, "--lockstep", platform=path) as served, Tap(served.device) as tap:
        _start_up_and_two_cycles(served, tap)
        sent, received = tap.sent, tap.received
    assert sent == SLCAN_OPENS + b"".join(_line(entry) for entry in log if entry[0] == ">")
    # Every frame sent is acknowledged by "z", C, S8 and O by an empty line; the plain emulated adapter knows
    # none of the four settings between them, and answers a BEL to each.
    answers = [b"z\r" if entry[0] == ">" else _line(entry) for entry in log]
    assert received.count(b"\a") == 4
    lines = [line for line in received.replace(b"\a", b"").split(b"\r") if line]
    assert sorted(lines) == sorted(answer.rstrip(b"\r") for answer in answers)
    assert [x for x in lines if x != b"z"] == [_line(e)[:-1] for e in log if e[0] == "<"]


def _start_up_and_two_cycles(served: EmulatorProcess, tap: Tap) -> None:
    assert served.ready.startswith("ready: /dev/pts/")
    regulator = open_regulator(single(), tap.path, lockstep=True)
    regulator.configure()
    regulator.exchange(np.array([20e3]), 0)
    regulator.exchange(np.array([20e3]), 5_000_000)
    regulator.link.bus.close_descriptor()  # without a word, so that nothing but the transcript is sent
