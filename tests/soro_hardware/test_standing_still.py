"""Driver or supervisor stand still (SIGSTOP): nobody waits for them, and the arm is vented."""

import contextlib
import os
import re
import signal
import time
from unittest import mock

import numpy as np
import pytest
from hardware_bench import cycles_in_real_time, wait_for
from serial_bench import alicat, itv
from served_bench import served

from benchmarks.stops import left_after, signalled
from soro_core.config import with_changes
from soro_hardware import load_platform, open_regulator
from soro_hardware.emulation import veab
from soro_hardware.port import EMPTY_PA
from soro_hardware.serial_line.driver import SerialRegulator
from soro_hardware.serial_line.line.setpoint import SlewedSetpoint
from soro_hardware.supervisor import SILENCE_S
from soro_hardware.supervisor_client import Supervisor, VentPlan

pytestmark = pytest.mark.process

# A call that waits takes as long as its timeout, which was 30 s; one that does not may lose the processor.
AT_ONCE_S = 0.15
STEP = {"send": "SET 0\r\n", "line": "0+"}


@pytest.fixture
def process():
    process = Supervisor()
    process.wait_until_ready()
    yield process
    process.dismiss()
    assert process.process.poll() is not None


@contextlib.contextmanager
def at_once():
    began_s = time.monotonic()
    yield
    assert time.monotonic() - began_s < AT_ONCE_S


@pytest.mark.parametrize(("rate_hz", "pressed"), [(500, True), (50, False), (5, True)])
def test_a_supervisor_that_stands_still_is_lost_in_time_at_any_rate(process, rate_hz, pressed):
    for _ in range(3):
        assert process.watches(pressed)
        time.sleep(1 / rate_hz)
    os.kill(process.pid, signal.SIGSTOP)
    stopped_s = time.monotonic()
    while True:
        with at_once():
            is_alive = process.watches(pressed)
        took_s = time.monotonic() - stopped_s
        if not is_alive:
            break
        assert took_s < 2.0
        time.sleep(1 / rate_hz)
    assert SILENCE_S - 0.1 < took_s < SILENCE_S + 1 / rate_hz + AT_ONCE_S
    assert "has stood still for 0." in process.lost
    os.kill(process.pid, signal.SIGCONT)
    time.sleep(0.1)
    assert not process.watches(False), "it stays lost"


def test_no_call_waits_for_one_that_reads_nothing(process):
    reader, writer = os.pipe()
    os.kill(process.pid, signal.SIGSTOP)
    plan = [VentPlan("/dev/test", (STEP,) * 100, 0.02, 1.0)]
    for _ in range(400):  # more than its socket takes
        with at_once():
            process.hold(plan, [writer])
        with at_once():
            process.release()
    assert not process.is_alive
    with at_once():
        process.watches(True)
    os.close(reader)
    os.close(writer)
    began_s = time.monotonic()
    process.dismiss()
    assert time.monotonic() - began_s < SILENCE_S + AT_ONCE_S


def test_a_driver_that_stood_still_under_pressure_has_lost_it(process):
    """Whether it has vented or not: between its time limit and this call there is no telling."""
    assert process.watches(True)
    time.sleep(SILENCE_S + 0.02)
    assert not process.watches(True)
    assert "the driver stood still for 0.3" in process.lost


def test_a_pause_at_rest_is_none_of_its_faults(process):
    """A machine that sleeps, or a debugger, stops both; without pressure nobody had to be quick."""
    assert process.watches(False)
    os.kill(process.pid, signal.SIGSTOP)
    time.sleep(2 * SILENCE_S)
    assert process.watches(False), "who continues first does not blame the other"
    os.kill(process.pid, signal.SIGCONT)
    time.sleep(SILENCE_S / 2)
    for _ in range(3):
        assert process.watches(False)
        time.sleep(SILENCE_S / 2)


MAKE = {
    "itv": itv,
    "alicat": alicat,
    "veab": lambda: load_platform("veab_tcp"),
    "vtem": lambda: load_platform("vtem_modbus"),
}
families = pytest.mark.parametrize("make", MAKE.values(), ids=MAKE)
PRESSURE_PA = 30e3


@contextlib.contextmanager
def under_pressure(platform):
    # The VEAB server keeps its pressure for ever after 0.5 s of silence, which a busy machine may exceed.
    patient = mock.patch.object(veab, "_SILENCE_NS", 30_000_000_000)
    with patient, served(platform) as (devices, address):
        regulator = open_regulator(platform, address)
        try:
            regulator.configure()
            target = [PRESSURE_PA] * 3
            wait_for(lambda: cycles_in_real_time(regulator, 0.1, target) and devices.pressure_pa.min() > 25e3)
            yield regulator, devices
        finally:
            regulator.close()


def pauses_once(regulator, monkeypatch):
    """Let the driver stand still in the midst of its next cycle, behind its word to the supervisor."""
    supervisor = regulator.supervisor
    watches = supervisor.watches

    def then_pauses(pressed):
        monkeypatch.setattr(supervisor, "watches", watches)
        alive = watches(pressed)
        wait_for(lambda: supervisor.process.poll() is not None)  # it has vented
        return alive

    monkeypatch.setattr(supervisor, "watches", then_pauses)


def transfers_of(regulator, monkeypatch):
    """Set points of all transfers from now on."""
    transfer, asked = regulator.transfer, []

    def noted(setpoint_pa, is_vent):
        asked.append(np.max(setpoint_pa))
        return transfer(setpoint_pa, is_vent)

    monkeypatch.setattr(regulator, "transfer", noted)
    return asked


@families
def test_a_driver_that_stood_still_within_a_cycle_sends_no_set_point_after_the_vent(make, monkeypatch):
    with under_pressure(make()) as (regulator, devices):
        pauses_once(regulator, monkeypatch)
        counts = []  # of a serial line, which reports its last set point until it is free for the next one
        monkeypatch.setattr(SlewedSetpoint, "sent", lambda self, *sent: counts.append(sent[0]))
        result = regulator.exchange([PRESSURE_PA] * 3, time.monotonic_ns())
        monkeypatch.undo()
        assert not any(counts)
        assert isinstance(regulator, SerialRegulator) or not result.sent_pa.any()
        (fault,) = [fault for fault in result.faults if fault.code == "supervisor_lost"]
        assert fault.latched
        assert re.search(r"the driver stood still for \d\.\d+ s", fault.message)  # longer on a busy machine
        assert devices.pressure_pa.max() < 5e3
        assert not cycles_in_real_time(regulator, 0.3, [PRESSURE_PA] * 3)[-1].sent_pa.any()
        assert devices.pressure_pa.max() < 5e3


@families
def test_a_driver_that_stood_still_in_its_last_ramp_stays_vented(make, monkeypatch):
    with under_pressure(with_changes(make(), shutdown_ramp_pa_s=20e3)) as (regulator, devices):
        pauses_once(regulator, monkeypatch)
        asked = transfers_of(regulator, monkeypatch)
        regulator.close()
        assert asked[0] > 0.9 * PRESSURE_PA, "it stood still in the first step of the ramp"
        assert not any(asked[1:])
        assert devices.pressure_pa.max() < 5e3


@families
def test_a_supervisor_that_stands_still_makes_the_driver_vent(make):
    with under_pressure(make()) as (regulator, devices):
        os.kill(regulator.supervisor.pid, signal.SIGSTOP)
        stopped_s, slowest_s, faults = time.monotonic(), 0.0, ()
        while not any(fault.latched for fault in faults):
            began_s = time.monotonic()
            faults = regulator.exchange([PRESSURE_PA] * 3, time.monotonic_ns()).faults
            slowest_s = max(slowest_s, time.monotonic() - began_s)
            assert began_s - stopped_s < 2.0
        assert slowest_s < AT_ONCE_S
        assert time.monotonic() - stopped_s < SILENCE_S + 2 * AT_ONCE_S
        assert {fault.code for fault in faults if fault.latched} == {"supervisor_lost"}
        wait_for(
            lambda: (
                cycles_in_real_time(regulator, 0.05, [PRESSURE_PA] * 3) and devices.pressure_pa.max() < 5e3
            )
        )
        regulator.configure()  # a reset starts another one
        assert cycles_in_real_time(regulator, 0.1, [0.0] * 3)[-1].faults == ()


@pytest.mark.parametrize("name", ["soro_board", "veab_tcp"])
def test_a_driver_that_is_stopped_and_continued_leaves_no_pressure(name):
    """Vented by what watches it, and not filled again; `benchmarks --only stops` does all."""
    outcome = signalled(name, "driver", signal.SIGSTOP, "under pressure")
    assert outcome.left_pa(0.0) > 35e3, "it was there"
    assert left_after(outcome, "under pressure") < EMPTY_PA
    assert any(codes for at_s, _, codes in outcome.cycles if at_s > 0), "it is latched"
