"""Check the hardware of a platform: permissions, adapter, devices, rates, sensors at rest.

The checks without hardware are pure functions. `Regulator.probe` makes the checks of the family. Then the
devices are started and held at 0 Pa for a moment. No check commands a pressure.
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

from soro_core.arrays import Array
from soro_core.errors import ConfigError, HardwareError
from soro_core.safety import Limits, check_rating, for_regulators
from soro_hardware.families import find_family, open_regulator
from soro_hardware.finding import Finding, grade, run_check
from soro_hardware.platform import IN_TURN, PlatformBase
from soro_hardware.port import FAULT_CODES, Regulator
from soro_hardware.supervisor import SILENCE_S

OFFSET_WARN_PA, OFFSET_FAIL_PA = 2e3, 5e3
NEEDED_PRIORITY = 30  # of the regulator node
START_UP = "start-up"
DUMP_VALVE = "a normally open dump valve is needed"


def examine(
    platform: PlatformBase,
    endpoint: str | None = None,
    run_s: float = 1.0,
    clock: Callable[[], float] = time.monotonic,
    limits: Limits | None = None,
) -> Iterator[Finding]:
    """Yield the findings of all checks, each after those that it depends on; stop after a failure.

    Parameters
    ----------
    platform : PlatformBase
        Description of the hardware.
    endpoint : str, optional
        Path or address that replaces the platform's device.
    run_s : float
        Time [s] for which the devices are held at 0 Pa; 0 to check without a start-up.
    clock : callable
        Returns a monotonic time [s].
    limits : Limits, optional
        Those that the scene of a run states; default: those of a scene that states none.
    """
    yield Finding("family", "ok", f"{platform.family}, tried on: {find_family(platform.family).tried_on}")
    yield check_range(platform, limits)
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
        # The rate of some devices is known only after their start-up.
        yield check_update(platform, regulator.update_hz)
        yield check_age(regulator.update_hz, regulator.reading_age_s)


def check_range(platform: PlatformBase, stated: Limits | None = None) -> Finding:
    """Check the range of set points against the rating of the arm and the limits of a run."""
    name, limits = "pressure range", stated or Limits()
    whose = "the default limits" if stated is None else "the limits of the scene"
    low, high = platform.range.minimum_pa / 1e3, platform.range.maximum_pa / 1e3
    found = f"{low:g} to {high:g} kPa, rated below {platform.rating.maximum_pa / 1e3:g} kPa"
    if limits.maximum_pa > platform.range.maximum_pa:
        found += f"; {whose} allow {limits.maximum_pa / 1e3:g} kPa, at which the arm trips"
        advice = f"`limits: {{maximum_pa: {platform.range.maximum_pa:g}}}` in the scene (--scene looks there)"
        return Finding(name, "warn", found, advice)
    try:
        check_rating(limits, platform.rating, where="")
    except ConfigError as error:
        found += f"; {whose} exceed it, and a run with them is refused"
        return Finding(name, "warn", found, f"in the scene, {error.key}: {error.allowed}")
    return Finding(name, "ok", found)


def check_update(platform: PlatformBase, update_hz: float) -> Finding:
    """Check the rate [Hz] of the updates of one chamber against the rate of the cycles."""
    found = f"{platform.cycle_hz:g} exchanges/s, each chamber served {update_hz:.3g} times a second"
    advice = "the line is slower than the loop, which extrapolates readings: plan slower motions"
    return grade("rate", found, (update_hz < IN_TURN * platform.cycle_hz, "warn", advice))


def check_age(update_hz: float, reading_age_s: float) -> Finding:
    """Check whether the readings arrive often enough for the monitors."""
    name, least_s = "age of readings", Limits().reading_age_s
    try:
        age_s = for_regulators(Limits(), update_hz, reading_age_s, where="").reading_age_s
    except ConfigError as error:
        found = f"{update_hz:.2g} readings of a chamber a second are too few to watch it"
        return Finding(name, "fail", found, error.allowed)
    found = f"a chamber without a reading for {age_s * 1e3:.0f} ms vents the arm"
    advice = f"a fast bus needs {least_s * 1e3:.0f} ms; these devices find a fault later"
    return grade(name, found, (age_s > least_s, "warn", advice))


def check_watchdog(platform: PlatformBase, in_the_devices: bool) -> Finding:
    """Check what vents when the driver dies: the devices, the supervisor, or nothing."""
    if in_the_devices:
        return Finding("device watchdog", "ok", "the devices vent by themselves when the host falls silent")
    found, advice = "none: the devices hold their last set point when the host falls silent", DUMP_VALVE
    if platform.is_supervised:
        found += f"; a second process vents when the driver dies or sends nothing for {SILENCE_S * 1e3:g} ms"
        return Finding("device watchdog", "warn", found, f"{advice}: the whole host may stop")
    found += ", and nothing else vents when the driver dies"
    key = platform.where_supervisor
    other = f"set `{key}: true` in the platform file" if key else "use devices that have a watchdog"
    return Finding("device watchdog", "fail", found, f"{other}; in any case {advice}")


def check_real_time(soft: int, hard: int, is_root: bool) -> Finding:
    """Check whether this user may set a real-time priority.

    Parameters
    ----------
    soft, hard : int
        Soft and hard limit of the priority (RLIMIT_RTPRIO).
    is_root : bool
        Whether the user is root.
    """
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
    """Check whether device files exist and may be opened; other addresses are checked by opening them.

    Parameters
    ----------
    address : str
        Path, several paths separated by commas, a folder of links, or a network address.
    """
    paths = [port for one in address.split(",") if "/" in one for port in _ports_of(Path(one))]
    return [
        check_path(path, os.access(path, os.R_OK | os.W_OK))
        for path in paths
        # An emulator on TCP makes a link with its address as target.
        if not (path.is_symlink() and ":" in os.readlink(path))
    ]


def _ports_of(path: Path) -> list[Path]:
    """Return the ports of a path: the links 0, 1, ... in the folder of an emulator, or the path itself."""
    found: list[Path] = []
    while os.path.lexists(port := path / str(len(found))):
        found.append(port)
    return found or [path]


def check_path(path: Path, may_open: bool) -> Finding:
    """Check existence and permission of a device file."""
    if path.is_dir():
        advice = (
            "name the device files in it, separated by commas; only `soro emulate` makes folders of devices"
        )
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
    """Check the readings of n chambers at rest, without pressure.

    Parameters
    ----------
    names : tuple of str
    pressure_pa, noise_pa : ndarray (n,)
        Mean and standard deviation of the readings [Pa gauge].
    """
    findings = []
    for name, pressure, noise in zip(names, pressure_pa, noise_pa, strict=True):
        what = f"offset of {name}"
        found = f"{pressure / 1e3:+.2f} kPa at rest, noise {noise / 1e3:.2f} kPa"
        is_read = bool(np.isfinite(pressure))
        wrong = (
            "vent the chamber and repeat the check; if the offset stays, correct the sensor or its scaling"
        )
        findings.append(
            grade(
                what,
                found if is_read else "no reading",
                (not is_read, "fail", "check the sensor and the mapping of the reading"),
                (abs(pressure) >= OFFSET_FAIL_PA, "fail", wrong),
                (abs(pressure) >= OFFSET_WARN_PA, "warn", "zero the sensor"),
            )
        )
    return findings


def hold_at_zero(
    platform: PlatformBase, regulator: Regulator, run_s: float, clock: Callable[[], float]
) -> Iterator[Finding]:
    """Start the devices, exchange zeros, and yield findings on start-up, rate, losses and offsets.

    Parameters
    ----------
    platform : PlatformBase
        Description of the hardware.
    regulator : Regulator
        Driver, not configured.
    run_s : float
        Duration of the exchange [s].
    clock : callable
        Returns a monotonic time [s].
    """
    try:
        regulator.configure()
    except HardwareError as error:
        yield Finding(START_UP, "fail", str(error), platform.start_advice)
        return
    yield Finding(START_UP, "ok", f"{regulator.n_chambers} regulators hold 0 Pa")
    yield from run_check("exchange", "check adapter and cable", _exchange(platform, regulator, run_s, clock))


def _exchange(
    platform: PlatformBase, regulator: Regulator, run_s: float, clock: Callable[[], float]
) -> Iterator[Finding]:
    readings, lost = [], regulator.statistics.frames_lost
    cycles = max(round(run_s * platform.cycle_hz), 1)
    start = clock()
    for cycle in range(cycles):
        time.sleep(max(start + cycle / platform.cycle_hz - clock(), 0.0))
        exchange = regulator.exchange(np.zeros(regulator.n_chambers), round(clock() * 1e9))
        if exchange.faults:
            fault = exchange.faults[0]
            text = f"{fault.code}: {fault.source}: {fault.message}"
            advice = f"{FAULT_CODES[fault.code]}: remove the cause and keep the limit"
            yield Finding("exchange", "fail", text, advice)
            return
        readings.append(exchange.pressure_pa)
    yield check_run(cycles, clock() - start, platform.cycle_hz, regulator.statistics.frames_lost - lost)
    settled = np.array(readings[len(readings) // 2 :])
    yield from check_offsets(regulator.chamber_names, settled.mean(axis=0), settled.std(axis=0))


def check_run(cycles: int, took_s: float, cycle_hz: float, lost: int) -> Finding:
    """Check rate and losses of some cycles.

    Parameters
    ----------
    cycles, lost : int
        Number of cycles, and of lost answers.
    took_s : float
        Duration of the cycles [s].
    cycle_hz : float
        Rate of the cycles according to the platform [Hz].
    """
    rate_hz = cycles / took_s
    found = f"{rate_hz:.0f} of {cycle_hz:g} cycles/s, {lost} answers lost in {cycles} cycles"
    cable = "check the cable (CAN: both terminators), and which other programs load this machine"
    slow = "this machine or bus does not keep up: lower cycle_hz"
    return grade("exchange", found, (lost > 0, "warn", cable), (rate_hz < IN_TURN * cycle_hz, "warn", slow))


def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)
