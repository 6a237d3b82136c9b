"""Check of a CANopen bus: budget, adapter, nodes; it only reads."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from soro_core.errors import HardwareError
from soro_hardware.canopen import cia408, frames
from soro_hardware.canopen.boot import startup
from soro_hardware.canopen.budget import USABLE, cycle_bits, highest_rate_hz, serial_rate_hz
from soro_hardware.canopen.config import SYNC_LATE_PERIODS, CanopenOptions, CanopenPlatform
from soro_hardware.canopen.device import Device
from soro_hardware.canopen.frames import NmtCommand, NmtState
from soro_hardware.canopen.sdo_client import SdoClient
from soro_hardware.error_text import IN_USE
from soro_hardware.finding import Finding, grade, run_check
from soro_hardware.transport.config import SlcanTransport, SocketcanTransport
from soro_hardware.transport.link import CanLink
from soro_hardware.transport.slcan import SlcanBus
from soro_hardware.transport.socketcand import SocketcandBus

LISTEN_S = 0.3
_DO = {
    "boot": "check its power, node id and bit rate, and the two terminators of 120 ohm",
    "device type": "another kind of device: choose canopen.mapping for it",
    "identity": "another device: exchange it, or correct canopen.vendor_id and canopen.product_code",
    "units": "set canopen.full_scale_pa or canopen.mapping.scaling from its data sheet",
}


def probe(
    platform: CanopenPlatform,
    device: Device,
    link: CanLink,
    clients: list[tuple[int, SdoClient]],
    endpoint: str | None,
    clock: Callable[[], float],
) -> Iterator[Finding]:
    """Yield findings, each after those that it depends on.

    Parameters
    ----------
    platform : CanopenPlatform
        Valves, transport and times.
    device : Device
        Kind of device.
    link : CanLink
        Link to the bus.
    clients : list of (int, SdoClient)
        Node ids with their clients.
    endpoint : str or None
        Path or address that replaces the platform's device.
    clock : callable
        Returns a monotonic time [s].
    """
    yield check_budget(
        cycle_bits(platform), highest_rate_hz(platform), platform.cycle_hz, platform.transport.bitrate
    )
    if isinstance(platform.transport, SlcanTransport):
        yield from check_serial(endpoint or platform.device or "", platform)
    if isinstance(platform.transport, SocketcanTransport) and endpoint is None:
        queue = Path("/sys/class/net", platform.transport.channel, "tx_queue_len")
        if queue.is_file():
            yield check_queue(int(queue.read_text()), platform, device)
    yield Finding("device description", "ok", f"{device.mapping.device}, {device.mapping.eds_path.name}")
    yield check_watchdogs(device, platform.canopen)
    try:
        link.open()
    except HardwareError as error:
        in_use = IN_USE in str(error)
        advice = "end that program" if in_use else "plug the adapter in, or correct transport and --device"
        yield Finding("adapter", "fail", str(error), advice)
        return
    found = _examine_bus(platform, device, link, clients, clock)
    yield from run_check("adapter", "check the adapter and its cable", found, link.close)


def _examine_bus(
    platform: CanopenPlatform,
    device: Device,
    link: CanLink,
    clients: list[tuple[int, SdoClient]],
    clock: Callable[[], float],
) -> Iterator[Finding]:
    if isinstance(link.bus, SlcanBus):
        yield check_acknowledgement(link.bus.acknowledges)
    elif isinstance(link.bus, SocketcandBus):
        yield check_error_frames()
    yield from _listen(platform, link, clock)
    for node, client in clients:
        finding = _ask(platform, device, client, node, clock)
        yield finding
        if finding.level == "ok" and device.has_sync_period:
            yield from check_sync(node, client.read(cia408.CYCLE_PERIOD), platform.canopen)
    yield check_adapter(link)


def check_budget(bits: int, highest_hz: float, cycle_hz: float, bitrate: int) -> Finding:
    """Check the rate of the cycle against the capacity of the bus.

    Parameters
    ----------
    bits : int
    highest_hz, cycle_hz : float
        Highest rate on the bus, and rate of the cycle [Hz].
    bitrate : int
        Bit rate [bit/s].
    """
    share = cycle_hz / highest_hz
    found = f"{bits} bits a cycle at {cycle_hz:g} Hz: {100 * share:.0f} % of {bitrate / 1e3:g} kbit/s"
    usable_hz = USABLE * highest_hz
    more = f"lower cycle_hz to {usable_hz:.0f}, or use nodes of several channels"
    close = f"leave {100 * (1 - USABLE):.0f} % for other frames: lower cycle_hz to {usable_hz:.0f}"
    return grade("bus budget", found, (share > 1, "fail", more), (share > USABLE, "warn", close))


def check_serial(device: str, platform: CanopenPlatform) -> Iterator[Finding]:
    """Check the rate of the cycle against the serial line of an slcan adapter, if it has a baud rate."""
    name = os.path.basename(os.path.realpath(device))
    assert isinstance(platform.transport, SlcanTransport)
    if not name.startswith(("ttyS", "ttyUSB", "ttyAMA")):
        return  # pseudo-terminals and USB CDC adapters have no baud rate
    baud = platform.transport.serial_baud
    highest_hz = serial_rate_hz(platform, baud)
    found = f"{baud} baud carry {highest_hz:.0f} cycles/s, the platform has {platform.cycle_hz:g}"
    advice = "use an adapter with native USB, or a higher transport.serial_baud"
    yield grade("serial line", found, (highest_hz < platform.cycle_hz, "fail", advice))


def check_queue(length: int, platform: CanopenPlatform, device: Device) -> Finding:
    """Check the transmit queue of a kernel interface against the frames of one cycle.

    Parameters
    ----------
    length : int
        Length of the queue [frames].
    platform : CanopenPlatform
        Valves and transport.
    device : Device
        Kind of device.
    """
    assert isinstance(platform.transport, SocketcanTransport)
    burst = len(platform.nodes) * len(device.rpdos) + 2  # heartbeat and SYNC
    found = f"{length} frames; a cycle sends {burst} at once"
    advice = f"`sudo ip link set {platform.transport.channel} txqueuelen {max(2 * burst, 64)}`"
    return grade("transmit queue", found, (length < burst, "warn", advice))


def check_watchdogs(device: Device, times: CanopenOptions) -> Finding:
    """Check the watchdogs in the device description, with their times."""
    deadline = any(device.has_deadline(pdo) for pdo in device.rpdos if pdo.cyclic)
    known = {
        "heartbeat consumer": (device.has_consumer, times.heartbeat_consumer_s),
        "node guarding": (device.is_guarded, times.life_time_factor * times.heartbeat_s),
        "set point deadline": (deadline, times.rpdo_deadline_s),
    }
    have = [f"{name} {after_s * 1e3:g} ms" for name, (there, after_s) in known.items() if there]
    advice = "give the maker's EDS as canopen.mapping.eds if the device has one"
    found = " and ".join(have) or "none in the EDS"
    return grade("watchdogs of the device", found, (not have, "warn", advice))


def check_acknowledgement(acknowledges: bool) -> Finding:
    """Check whether an slcan adapter acknowledges commands."""
    name = "acknowledgement"
    if acknowledges:
        return Finding(name, "ok", "the adapter acknowledges each command")
    found = (
        "the adapter acknowledges no command (like the stock firmware of the CANable): soro cannot see a "
        "command that it loses, nor bus-off"
    )
    return Finding(name, "warn", found, "use an adapter or firmware that acknowledges")


def check_sync(node: int, period_us: int, times: CanopenOptions) -> Iterator[Finding]:
    """Check a period of SYNC that an earlier host has set in a node.

    Parameters
    ----------
    node : int
        Node id.
    period_us : int
        Period of SYNC in the node [us].
    times : CanopenOptions
        Times of the driver.
    """
    watched_s = SYNC_LATE_PERIODS * period_us * 1e-6
    if times.sync_period_s is None and 0 < watched_s < times.rpdo_deadline_s:
        found = f"1006 is {period_us} us: the device may report an error {watched_s * 1e3:g} ms after a SYNC"
        yield Finding(
            f"SYNC of node {node}",
            "warn",
            found,
            "set 1006 to 0 in the device, or switch its power off and on",
        )


def check_error_frames() -> Finding:
    """Warn that socketcand reports bus errors only with an option, which a host cannot check."""
    found = "socketcand reports errors on the bus, and bus-off, only if it was started with -e"
    advice = (
        "start socketcand with -e; on its machine `ip -details link show` shows the state of the controller"
    )
    return Finding("error frames", "warn", found, advice)


def check_adapter(link: CanLink) -> Finding:
    """Check the state of the controller and its counts."""
    counts = link.counts
    found = f"open, {link.received} frames received, {counts['errors']} errors, {counts['garbled']} garbled"
    advice, has_errors = "check bit rate, wiring and terminators", bool(counts["errors"] or counts["garbled"])
    if link.is_bus_off:
        return Finding("adapter", "fail", f"{found}, off the bus", advice)
    return grade("adapter", found, (has_errors, "warn", advice))


def _listen(platform: CanopenPlatform, link: CanLink, clock: Callable[[], float]) -> Iterator[Finding]:
    """Check for other nodes on the bus; a heartbeat with the host's id comes from another host."""
    known = {valve.node for valve in platform.valves}
    states: dict[int, int] = {}
    end = clock() + LISTEN_S
    while (left := end - clock()) > 0:
        frame = link.receive(left)
        if frame is not None and not frame.extended and len(frame.data) == 1:
            node = frame.can_id - frames.HEARTBEAT_BASE
            if 1 <= node <= 127:
                states[node] = frame.data[0]
    if platform.canopen.master_node in states:
        text = f"a heartbeat of node {platform.canopen.master_node}, which is the host's"
        yield Finding("other hosts", "fail", text, "stop the other driver, or change canopen.master_node")
    strangers = sorted(states.keys() - known - {platform.canopen.master_node})
    if strangers:
        listed = ", ".join(f"{node} ({_state(states[node])})" for node in strangers)
        advice = "add them to valves, or check that they belong there"
        yield Finding("other nodes", "warn", f"not in the platform: {listed}", advice)
    # After an orderly end the nodes are stopped, and answer only network management.
    stopped = [node for node in sorted(known & states.keys()) if states[node] & 0x7F == NmtState.STOPPED]
    link.send([frames.nmt(NmtCommand.PRE_OPERATIONAL, node) for node in stopped])


def _state(value: int) -> str:
    try:
        return NmtState(value & 0x7F).name.lower().replace("_", "-")
    except ValueError:
        return f"0x{value:02X}"


def _ask(
    platform: CanopenPlatform, device: Device, client: SdoClient, node: int, clock: Callable[[], float]
) -> Finding:
    name, start = f"node {node}", clock()
    try:
        startup.wait_for_boot(client, min(platform.canopen.boot_timeout_s, 1.0))
        kind, vendor, product = startup.check_identity(client, platform, device)
        scale = startup.read_scaling(client, platform, device, 0)
        status = device.find("status", 0)
        state = "" if status is None else cia408.state_of(client.read(status.index, status.sub)).value[0]
    except HardwareError as error:
        return Finding(name, "fail", str(error), _DO.get(client.step, "see the device's manual"))
    took_ms = 1e3 * (clock() - start)
    found = (
        f"profile {kind & 0xFFFF}, vendor 0x{vendor:X}, product 0x{product:X}, "
        f"{scale.setpoint_pa:g} Pa a count{f', {state}' if state else ''} ({took_ms:.0f} ms)"
    )
    return Finding(name, "ok", found)
