"""Examine the hardware of a platform: permissions, adapter, devices, rates, sensors at rest.

The checks that need nothing opened are pure functions of what they are given. What only a family knows is its
driver's `Regulator.probe`; whatever the family, the devices are then started and held at 0 Pa for a moment.
Nothing here ever commands a pressure.
"""

from __future__ import annotations

import contextlib
import grp
import os
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from soro_core.errors import ConfigError, HardwareError
from soro_core.hardware.finding import Finding
from soro_core.hardware.platform import IN_TURN, PlatformBase, open_regulator
from soro_core.hardware.port import FAULT_CODES, Array, Regulator
from soro_core.hardware.supervisor import SILENCE_S
from soro_core.safety import Limits, check_rating, for_regulators

OFFSET_WARN_PA, OFFSET_FAIL_PA = 2e3, 5e3
NEEDED_PRIORITY = 30  # of the regulator node
START_UP = "start-up"
DUMP_VALVE = "a normally open dump valve is needed"


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
    yield check_range(platform)
    yield check_real_time(*resource.getrlimit(resource.RLIMIT_RTPRIO), os.geteuid() == 0)
    address = endpoint or platform.device
    failed = False
    if address is None:
        advice = (
            f"give it as {platform.where_device} in the platform file, or with --device; `soro emulate` "
            "prints one"
        )
        yield Finding("device", "fail", platform.missing_device, advice)
        return
    for finding in check_device(address):
        failed |= finding.level == "fail"
        yield finding
    with contextlib.closing(open_regulator(platform, endpoint, clock)) as regulator:
        yield check_watchdog(platform, regulator.device_watchdog)
        for finding in () if failed else regulator.probe():
            failed |= finding.level == "fail"
            yield finding
        for finding in hold_at_zero(platform, regulator, run_s, clock) if run_s > 0 and not failed else ():
            failed |= finding.level == "fail" and finding.name == START_UP
            yield finding
        if failed:
            return
        # Devices that differ in their rates have told it by now.
        yield check_update(platform, regulator.update_hz)
        yield check_age(regulator.update_hz, regulator.reading_age_s)


def check_range(platform: PlatformBase) -> Finding:
    """Set points beside what the mechanics bear, and beside what a run asks for if it sets no limits."""
    name, limits = "pressure range", Limits()
    low, high = platform.range.minimum_pa / 1e3, platform.range.maximum_pa / 1e3
    found = f"{low:g} to {high:g} kPa, rated below {platform.rating.maximum_pa / 1e3:g} kPa"
    if limits.maximum_pa > platform.range.maximum_pa:
        found += f"; the default limits let {limits.maximum_pa / 1e3:g} kPa through, which trips the arm"
        advice = f"`limits: {{maximum_pa: {platform.range.maximum_pa:g}}}` in the scene"
        return Finding(name, "warn", found, advice)
    try:
        check_rating(limits, platform.rating, where="")
    except ConfigError as error:
        found += "; the default limits go beyond it, and a run with them is refused"
        return Finding(name, "warn", found, f"in the scene, {error.key}: {error.allowed}")
    return Finding(name, "ok", found)


def check_update(platform: PlatformBase, update_hz: float) -> Finding:
    """How often a chamber is served against the rate of exchanges."""
    found = f"{platform.cycle_hz:g} exchanges/s, each chamber served {update_hz:.3g} times a second"
    if update_hz < IN_TURN * platform.cycle_hz:
        advice = "the line is slower than the loop, which carries readings on in between: plan motions for it"
        return Finding("rate", "warn", found, advice)
    return Finding("rate", "ok", found)


def check_age(update_hz: float, reading_age_s: float) -> Finding:
    """Whether the devices give readings often enough to be watched."""
    name, least_s = "age of readings", Limits().reading_age_s
    try:
        age_s = for_regulators(Limits(), update_hz, reading_age_s, where="").reading_age_s
    except ConfigError as error:
        found = f"{update_hz:.2g} readings of a chamber a second are too few to watch it"
        return Finding(name, "fail", found, error.allowed)
    found = f"a chamber without a reading for {age_s * 1e3:.0f} ms vents the arm"
    if age_s > least_s:
        advice = f"{least_s * 1e3:.0f} ms on a fast bus: a fault is found so much later here"
        return Finding(name, "warn", found, advice)
    return Finding(name, "ok", found)


def check_watchdog(platform: PlatformBase, in_the_devices: bool) -> Finding:
    """What vents when the driver dies: the devices, a second process of this host, or nothing."""
    if in_the_devices:
        return Finding("device watchdog", "ok", "the devices vent by themselves when the host falls silent")
    found, advice = "none: the devices hold their last set point when the host falls silent", DUMP_VALVE
    if platform.is_supervised:
        found += f"; a second process vents when the driver dies, or says nothing for {SILENCE_S * 1e3:g} ms"
        return Finding("device watchdog", "warn", found, f"{advice}: this host may stop as a whole")
    found += ", and nothing else vents when the driver dies"
    key = platform.where_supervisor
    other = f"`{key}: true` in the platform file" if key else "devices that have a watchdog"
    return Finding("device watchdog", "fail", found, f"{other}; in any case {advice}")


def check_real_time(soft: int, hard: int, is_root: bool) -> Finding:
    """Whether this user may ask for a real-time priority."""
    if is_root or soft >= NEEDED_PRIORITY or soft == resource.RLIM_INFINITY:
        return Finding("real-time priority", "ok", "permitted")
    allowed = f"up to {soft}, {NEEDED_PRIORITY} needed" if soft else "not permitted"
    advice = (
        "`@soro - rtprio 50` in /etc/security/limits.d/soro.conf, `sudo usermod -aG soro $USER`, log in again"
    )
    if hard == resource.RLIM_INFINITY or hard >= NEEDED_PRIORITY:
        advice = f"`ulimit -r {NEEDED_PRIORITY}` in this shell"
    return Finding("real-time priority", "warn", f"{allowed}: cycles may be late under load", advice)


def check_device(address: str) -> list[Finding]:
    """Whether device files are there and may be opened; other addresses are found out by opening them.

    Parameters
    ----------
    address : str
        Path, several with commas, a folder of links, or something else.
    """
    paths = [port for one in address.split(",") if "/" in one for port in _ports_of(Path(one))]
    return [
        check_path(path, os.access(path, os.R_OK | os.W_OK))
        for path in paths
        # An emulator on TCP is a link that reads as an address.
        if not (path.is_symlink() and ":" in os.readlink(path))
    ]


def _ports_of(path: Path) -> list[Path]:
    """What a path stands for: an emulator of several ports is a folder of links 0, 1, and so on."""
    found: list[Path] = []
    while os.path.lexists(port := path / str(len(found))):
        found.append(port)
    return found or [path]


def check_path(path: Path, may_open: bool) -> Finding:
    """Existence and permission of a device file."""
    if path.is_dir():
        advice = "name a device in it, with commas between several; only `soro emulate` makes folders of them"
        return Finding("device", "fail", f"{path} is a folder", advice)
    if not path.exists():
        advice = "plug the adapter in; `ls -l /dev/serial/by-id` lists serial adapters"
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
        yield Finding(START_UP, "fail", str(error), platform.start_advice)
        return
    yield Finding(START_UP, "ok", f"{regulator.n_chambers} regulators hold 0 Pa")
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
                advice = f"{FAULT_CODES[fault.code]}: mend the cause, not the limit"
                yield Finding("exchange", "fail", text, advice)
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
        advice = "look at the cable (CAN: both terminators), and at what else runs on this machine"
        return Finding("exchange", "warn", found, advice)
    if rate_hz < IN_TURN * cycle_hz:
        return Finding("exchange", "warn", found, "this machine or bus does not keep up: lower cycle_hz")
    return Finding("exchange", "ok", found)


def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)
