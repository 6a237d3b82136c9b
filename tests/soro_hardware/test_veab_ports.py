"""A server with another number of ports than the platform says: found before it is asked for any air.

The driver runs as in real time, on the emulated devices' own clock, so that nothing depends on the machine.
"""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from board_bench import VEAB, RecordingLink, VeabBench, file_of, veab_platform
from hardware_bench import driver, emulator
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.errors import HardwareError
from soro_hardware import load_platform
from soro_hardware.emulation.veab import EmulatedVeabServer
from soro_hardware.veab.driver import VeabRegulator
from soro_hardware.veab.stream import PortCount
from tests.refused import fails

MS = 1_000_000


class TimedLink(RecordingLink):
    """A link whose waiting lets the devices' time go on, as in real time."""

    def __init__(self, devices: EmulatedVeabServer) -> None:
        super().__init__(devices.line)
        self.devices = devices

    def clock(self) -> float:
        """Time of the devices [s]."""
        return self.devices.now_ns * 1e-9

    def receive(self, timeout_s: float) -> bytes:
        end_ns = self.devices.now_ns + math.ceil(timeout_s * 1e9)
        while not (chunk := super().receive(0.0)) and self.devices.now_ns < end_ns:
            self.devices.run(min(self.devices.now_ns + MS // 2, end_ns))
        return chunk


class Timed:
    """A driver as in real time on a server with `there` ports, whose readings wait for one another."""

    def __init__(self, ports: int, there: int, gather_s: float = 0.0, **changes: Any) -> None:
        valves = [{"chamber": f"link0/chamber{n}", "port": n} for n in range(min(ports, 3))]
        platform = veab_platform(
            valves=valves,
            ports=ports,
            host={"supervisor": False, **changes.pop("host", {})},
            emulation={"ports": there, "gather_s": gather_s, **changes},
        )
        self.devices = EmulatedVeabServer(platform, lockstep=False, seed=3)
        self.link = TimedLink(self.devices)
        self.driver = VeabRegulator(platform, self.link, self.link.clock)

    @property
    def asked(self) -> set[float]:
        """Every value that went to the server."""
        sent = b"".join(data for mark, data in self.link.log if mark == ">")
        return set(np.frombuffer(sent, "<f8").tolist())

    def refusal(self) -> str:
        """Why the start-up is refused."""
        with pytest.raises(HardwareError) as error:
            self.driver.configure()
        self.driver.close()
        return str(error.value)


OTHERS = [
    (12, 4), (12, 6), (12, 3), (12, 2), (12, 1), (12, 8), (12, 5), (12, 11), (12, 24), (12, 64),
    (4, 12), (4, 2), (4, 8), (6, 12), (3, 4), (1, 2), (2, 1), (64, 32), (64, 63),
]  # fmt: skip
GATHERED_S = [0.0, 0.006, 0.008, 0.012, 0.04]


@pytest.mark.parametrize(("ports", "there"), OTHERS)
def test_another_number_is_named_before_any_air(ports, there):
    for gather_s in GATHERED_S:
        timed = Timed(ports, there, gather_s)
        assert "`ports`" in timed.refusal()
        assert timed.asked <= {0.5}, "0.5 is 0 kPa"
        assert not timed.link.is_open
        assert [dac.normalized_value for dac in timed.devices.dacs] == [0.5] * there


@pytest.mark.parametrize("ports", [1, 2, 4, 6, 12, 64])
def test_the_right_number_is_accepted_however_readings_are_joined(ports):
    for gather_s in GATHERED_S:
        timed = Timed(ports, ports, gather_s)
        timed.driver.configure()
        assert timed.driver.seen_empty
        assert timed.devices.ended is None
        assert timed.link.clock() < 0.4
        timed.driver.close()


def test_a_server_of_another_number_is_sent_nothing():
    """A message of the wrong length would end it; its own start has let the air go."""
    for ports, there in ((12, 8), (4, 12)):
        timed = Timed(ports, there)
        assert f"the server's readings have {there} values" in timed.refusal()
        assert timed.asked == set()


# -- the readings alone ----------------------------------------------------------------------------


def pieces(ports: int, joined: Any, seconds: float = 1.0, push_hz: float = 250.0) -> Any:
    """Times and sizes of the pieces of a stream; `joined` gives how many readings the next one has."""
    count = 0
    while (now_s := count / push_hz) < seconds:
        number = joined()
        count += number
        yield now_s, 8 * ports * number


def judged(stated: int, stream: Any, push_hz: float = 250.0) -> PortCount:
    count = PortCount(stated, push_hz)
    for now_s, size in stream:
        count.take(size, now_s)
    return count


@pytest.mark.parametrize("stated", [1, 2, 3, 4, 6, 8, 12])
def test_readings_that_are_always_joined_alike_never_pass_for_another_number(stated):
    """The worst network: the same number of readings in every piece, for a second."""
    for there, together in itertools.product(range(1, 25), (1, 2, 3, 4, 5, 6, 10, 12)):
        count = judged(stated, pieces(there, lambda together=together: together))
        assert count.fits or not (there == stated and together == 1)
        assert count.fits is not True or there == stated
        assert f"`ports` of the platform file is {stated}" in str(count)


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.integers(1, 12), st.integers(1, 12), st.lists(st.integers(1, 12), min_size=1, max_size=30))
def test_no_pattern_of_joined_readings_passes_for_another_number(stated, there, pattern):
    count = judged(stated, pieces(there, itertools.cycle(pattern).__next__))
    if stated != there:
        assert count.fits is not True
    elif 1 in pattern and sum(pattern) < 40:
        assert count.fits


def test_a_slow_server_is_refused_until_its_rate_is_stated():
    """With half of the ports, and its readings joined in pairs, a quick one would look the same."""
    slow = list(pieces(12, lambda: 1, push_hz=120.0))
    assert judged(12, slow).fits is None
    assert str(judged(12, slow)).startswith(
        "12 values come 120 times a second, and the server sends 250 read"
    )
    assert "host.push_hz" in str(judged(12, slow))
    assert judged(12, slow, push_hz=120.0).fits
    assert judged(12, pieces(6, lambda: 2)).fits is None
    assert "they have 6 values" in str(judged(12, pieces(6, lambda: 2)))


def test_a_number_that_is_known_stays_known():
    """Bytes that get lost later are another fault: set points of 0 Pa must still go out."""
    count = judged(4, [*pieces(4, lambda: 1), (1.1, 5), (1.2, 32)])
    assert count.fits
    assert count.may_send


def test_bytes_that_are_no_readings():
    assert "sends 3 bytes where each of its ports has 8" in str(
        judged(4, [(0.004 * n, 3) for n in range(80)])
    )
    assert str(PortCount(4, 250.0)) == "the server sends no readings, and `ports` of the platform file is 4"


# -- the driver ------------------------------------------------------------------------------------


def test_lockstep():
    for ports, there in ((12, 4), (4, 12), (4, 5)):
        bench = VeabBench(veab_platform(ports=ports, emulation={"ports": there}))
        with fails(HardwareError, f"{there} values", "`ports`", f"is {ports}", code="refused"):
            bench.driver.configure()
        assert [mark for mark, _ in bench.link.take_log()] == ["<"]


def test_a_server_started_again_with_another_number_is_not_taken_for_the_one_before():
    bench = VeabBench(veab_platform())
    bench.driver.configure()
    bench.run(100, 20e3)
    bench.devices.end("killed")
    bench.run(2, 20e3)
    other = EmulatedVeabServer(veab_platform(emulation={"ports": 2}), lockstep=True)
    bench.link.line, bench.devices = other.line, other
    bench.link.take_log()
    result = bench.run(10, 20e3)
    assert not result.fresh.any()
    assert "`ports`" in " ".join(fault.message for fault in result.faults)
    assert [mark for mark, _ in bench.link.take_log() if mark == ">"] == []
    with fails(HardwareError, "ports", step="start-up"):
        bench.driver.configure()


@pytest.mark.process
def test_over_tcp(tmp_path):
    """The mistake as it is made: the shipped file's 12 ports, and a server with two boards."""
    path = file_of(tmp_path, VEAB, ports=12, emulation={"ports": 4})
    with (
        emulator(tmp_path, platform=path) as served,
        fails(HardwareError, "4 values", "is 12", "`ports`", step="start-up", code="refused"),
        driver(load_platform(path), served.device, lockstep=False),
    ):
        pass
