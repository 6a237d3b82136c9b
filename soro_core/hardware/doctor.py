"""Examine the hardware of a platform: permissions, adapter, devices, rates, sensors at rest.

The checks that need nothing opened are pure functions of what they are given. What only a family knows is its
driver's `Regulator.probe`; whatever the family, the devices are then started and held at 0 Pa for a moment.
Nothing here ever commands a pressure.
"""

from __future__ import annotations

import grp
import os
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.finding import Finding
from soro_core.hardware.platform import PlatformBase, open_regulator
from soro_core.hardware.port import Array, Regulator

OFFSET_WARN_PA, OFFSET_FAIL_PA = 2e3, 5e3
RATE_TOLERANCE = 0.9


def examine(
    platform: PlatformBase,
    endpoint: str | None = None,
    run_s: float = 1.0,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Finding]:
    """Look at everything, in the order in which it has to work; later steps are left out after a failure.

    Parameters
    ----------
    platform : PlatformBase
        What the hardware should be.
    endpoint : str, optional
        What takes the place of the platform's device.
    run_s : float
        Time for which the devices are held at 0 Pa; 0 to look only, without starting them.
    clock : callable
        Monotonic time [s].
    """
    regulator = open_regulator(platform, endpoint, clock)
    yield check_range(platform)
    yield check_update(platform, regulator.update_hz)
    yield check_watchdog(regulator.device_watchdog)
    yield check_real_time(*resource.getrlimit(resource.RLIMIT_RTPRIO), os.geteuid() == 0)
    address = endpoint or platform.device
    failed = False
    for finding in (*check_device(address), *([] if address is None else regulator.probe())):
        failed |= finding.level == "fail"
        yield finding
    if not failed and run_s > 0:
        yield from hold_at_zero(platform, regulator, run_s, clock)
    regulator.close()


def check_range(platform: PlatformBase) -> Finding:
    """Set points against what the mechanics bear."""
    low, high = platform.range.minimum_pa / 1e3, platform.range.maximum_pa / 1e3
    found = f"{low:g} to {high:g} kPa, rated below {platform.rating.maximum_pa / 1e3:g} kPa"
    if platform.range.maximum_pa >= platform.rating.maximum_pa:
        return Finding("pressure range", "fail", found, "lower range.maximum_pa in the platform")
    return Finding("pressure range", "ok", found)


def check_update(platform: PlatformBase, update_hz: float) -> Finding:
    """How often a chamber is served against the rate of exchanges."""
    found = f"{platform.cycle_hz:g} exchanges/s, each chamber served {update_hz:.3g} times a second"
    if update_hz < platform.cycle_hz * RATE_TOLERANCE:
        advice = "the line is slower than the loop: plan motions for it, or lower cycle_hz"
        return Finding("rate", "warn", found, advice)
    return Finding("rate", "ok", found)


def check_watchdog(present: bool) -> Finding:
    """Whether the devices vent by themselves."""
    if present:
        return Finding("device watchdog", "ok", "the devices vent by themselves when the host falls silent")
    found = "the devices hold their last set point when the host falls silent"
    return Finding("device watchdog", "warn", found, "a normally open dump valve is needed")


def check_real_time(soft: int, hard: int, is_root: bool) -> Finding:
    """Whether this user may ask for a real-time priority."""
    if is_root or soft > 0 or soft == resource.RLIM_INFINITY:
        return Finding("real-time priority", "ok", "permitted")
    more = f"allowed up to {hard}" if hard else "not permitted"
    advice = "in /etc/security/limits.d/soro.conf: `@realtime - rtprio 80`; join that group and log in again"
    return Finding("real-time priority", "warn", f"{more}: cycles may be late under load", advice)


def check_device(address: str | None) -> list[Finding]:
    """Whether a device file is there and may be opened; other addresses are found out by opening them."""
    if address is None:
        advice = "give it with --device, or as transport.device in the platform"
        return [Finding("device", "fail", "the platform names none", advice)]
    return [
        finding
        for one in address.split(",")
        if "/" in one and (finding := check_path(Path(one), os.access(one, os.R_OK | os.W_OK))) is not None
    ]


def check_path(path: Path, may_open: bool) -> Finding:
    """Existence and permission of a device file."""
    if not path.exists():
        advice = "plug the adapter in; `ls /dev/serial/by-id` lists serial adapters"
        return Finding("device", "fail", f"{path} does not exist", advice)
    if may_open:
        return Finding("device", "ok", f"{path} may be opened")
    group = _group(path.stat().st_gid)
    advice = f"`sudo usermod -aG {group} $USER`, then log in again"
    return Finding("device", "fail", f"no permission for {path} (group {group})", advice)


def check_offsets(names: tuple[str, ...], pressure_pa: Array, noise_pa: Array) -> list[Finding]:
    """Readings of chambers that should be at rest, without pressure."""
    findings = []
    for name, pressure, noise in zip(names, pressure_pa, noise_pa, strict=True):
        what = f"offset of {name}"
        found = f"{pressure / 1e3:+.2f} kPa at rest, noise {noise / 1e3:.2f} kPa"
        if not np.isfinite(pressure):
            findings.append(
                Finding(what, "fail", "no reading", "check the sensor and the mapping of the reading")
            )
        elif abs(pressure) >= OFFSET_FAIL_PA:
            advice = "vent the chamber and look again; if it stays, the sensor or its scaling is wrong"
            findings.append(Finding(what, "fail", found, advice))
        elif abs(pressure) >= OFFSET_WARN_PA:
            findings.append(Finding(what, "warn", found, "zero the sensor"))
        else:
            findings.append(Finding(what, "ok", found))
    return findings


def hold_at_zero(
    platform: PlatformBase, regulator: Regulator, run_s: float, clock: Callable[[], float]
) -> Iterator[Finding]:
    """Start the devices and exchange zeros: does everything answer, how fast, and what do the sensors say?"""
    try:
        regulator.configure()
    except HardwareError as error:
        yield Finding("start-up", "fail", str(error), "see the lines above, and the device's manual")
        return
    yield Finding("start-up", "ok", f"{regulator.n_chambers} regulators hold 0 Pa")
    readings, lost = [], regulator.statistics.frames_lost
    cycles = max(round(run_s * platform.cycle_hz), 1)
    start = clock()
    try:
        for cycle in range(cycles):
            time.sleep(max(start + cycle / platform.cycle_hz - clock(), 0.0))
            exchange = regulator.exchange(np.zeros(regulator.n_chambers), round(clock() * 1e9))
            if exchange.faults:
                fault = exchange.faults[0]
                text = f"{fault.code}: {fault.source}: {fault.message}"
                yield Finding("exchange", "fail", text, "mend the cause; longer time limits only hide it")
                return
            readings.append(exchange.pressure_pa)
    except HardwareError as error:
        yield Finding("exchange", "fail", str(error), "check adapter and cable")
        return
    yield check_run(cycles, clock() - start, platform.cycle_hz, regulator.statistics.frames_lost - lost)
    settled = np.array(readings[len(readings) // 2 :])
    yield from check_offsets(regulator.chamber_names, settled.mean(axis=0), settled.std(axis=0))


def check_run(cycles: int, took_s: float, cycle_hz: float, lost: int) -> Finding:
    """Rate and losses of the exchanges that were made."""
    rate_hz = cycles / took_s
    found = f"{rate_hz:.0f} of {cycle_hz:g} cycles/s, {lost} answers lost in {cycles} cycles"
    if lost:
        return Finding("exchange", "warn", found, "look at wiring, terminators and the load of this machine")
    if rate_hz < RATE_TOLERANCE * cycle_hz:
        return Finding("exchange", "warn", found, "this machine or bus does not keep up: lower cycle_hz")
    return Finding("exchange", "ok", found)


def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)
