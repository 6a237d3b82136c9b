"""What the doctor asks a CANopen bus: budget, adapter, who is there. It only reads what is running."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from soro_core.errors import HardwareError
from soro_core.hardware.canopen import cia408, frames, startup
from soro_core.hardware.canopen.budget import USABLE, cycle_bits, highest_rate_hz, serial_rate_hz
from soro_core.hardware.canopen.config import CanopenOptions, CanopenPlatform
from soro_core.hardware.canopen.device import Device
from soro_core.hardware.canopen.frames import NmtCommand, NmtState
from soro_core.hardware.canopen.sdo_client import SdoClient
from soro_core.hardware.finding import Finding
from soro_core.hardware.reason import IN_USE
from soro_core.hardware.transport.config import SlcanTransport, SocketcanTransport
from soro_core.hardware.transport.link import CanLink

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
    """Findings in the order in which things have to work."""
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
        advice = "end that program" if in_use else "plug it in, or correct transport and --device"
        yield Finding("adapter", "fail", str(error), advice)
        return
    try:
        yield from _listen(platform, link, clock)
        for node, client in clients:
            yield _ask(platform, device, client, node)
        yield check_adapter(link)
    except HardwareError as error:
        yield Finding("adapter", "fail", str(error), "check the adapter and its cable")
    finally:
        link.close()


def check_budget(bits: int, highest_hz: float, cycle_hz: float, bitrate: int) -> Finding:
    """Rate of the cycle against what the bus carries."""
    share = cycle_hz / highest_hz
    found = f"{bits} bits a cycle at {cycle_hz:g} Hz: {100 * share:.0f} % of {bitrate / 1e3:g} kbit/s"
    usable_hz = USABLE * highest_hz
    if share > 1:
        advice = f"lower cycle_hz to {usable_hz:.0f}, or use nodes of several channels"
        return Finding("bus budget", "fail", found, advice)
    if share > USABLE:
        advice = f"leave {100 * (1 - USABLE):.0f} % for the rest: lower cycle_hz to {usable_hz:.0f}"
        return Finding("bus budget", "warn", found, advice)
    return Finding("bus budget", "ok", found)


def check_serial(device: str, platform: CanopenPlatform) -> Iterator[Finding]:
    """Rate of the cycle against the serial line of an slcan adapter, where it is a real one."""
    name = os.path.basename(os.path.realpath(device))
    assert isinstance(platform.transport, SlcanTransport)
    if not name.startswith(("ttyS", "ttyUSB", "ttyAMA")):
        return  # pseudo-terminals and USB CDC adapters have no baud rate
    baud = platform.transport.serial_baud
    highest_hz = serial_rate_hz(platform, baud)
    found = f"{baud} baud carry {highest_hz:.0f} cycles/s, {platform.cycle_hz:g} are asked for"
    if highest_hz < platform.cycle_hz:
        yield Finding(
            "serial line", "fail", found, "an adapter with native USB, or more transport.serial_baud"
        )
    else:
        yield Finding("serial line", "ok", found)


def check_queue(length: int, platform: CanopenPlatform, device: Device) -> Finding:
    """Transmit queue of a kernel interface against the frames that a cycle sends at once."""
    assert isinstance(platform.transport, SocketcanTransport)
    burst = len(platform.nodes) * len(device.rpdos) + 2  # heartbeat and SYNC
    found = f"{length} frames, a cycle sends {burst} at once"
    if length < burst:
        advice = f"`sudo ip link set {platform.transport.channel} txqueuelen {max(2 * burst, 64)}`"
        return Finding("transmit queue", "warn", found, advice)
    return Finding("transmit queue", "ok", found)


def check_watchdogs(device: Device, times: CanopenOptions) -> Finding:
    """Which watchdogs the device description has, and after what time they vent."""
    deadline = any(device.has_deadline(pdo) for pdo in device.rpdos if pdo.cyclic)
    known = {
        "heartbeat consumer": (device.has_consumer, times.heartbeat_consumer_s),
        "node guarding": (device.is_guarded, times.life_time_factor * times.heartbeat_s),
        "set point deadline": (deadline, times.rpdo_deadline_s),
    }
    have = [f"{name} {after_s * 1e3:g} ms" for name, (there, after_s) in known.items() if there]
    if not have:
        advice = "give the maker's EDS as canopen.mapping.eds if the device has one"
        return Finding("watchdogs of the device", "warn", "none in the EDS", advice)
    return Finding("watchdogs of the device", "ok", " and ".join(have))


def check_adapter(link: CanLink) -> Finding:
    """State of the controller, and what it has counted."""
    counts = link.counts
    found = f"open, {link.received} frames heard, {counts['errors']} errors, {counts['garbled']} garbled"
    if link.is_bus_off:
        return Finding("adapter", "fail", f"{found}, off the bus", "check bit rate, wiring and terminators")
    if counts["errors"] or counts["garbled"]:
        return Finding("adapter", "warn", found, "check bit rate, wiring and terminators")
    return Finding("adapter", "ok", found)


def _listen(platform: CanopenPlatform, link: CanLink, clock: Callable[[], float]) -> Iterator[Finding]:
    """Who else is there; a heartbeat of the host's own id means that another host drives these valves."""
    known = {valve.node for valve in platform.valves}
    heard: dict[int, int] = {}
    end = clock() + LISTEN_S
    while (left := end - clock()) > 0:
        frame = link.receive(left)
        if frame is not None and not frame.extended and len(frame.data) == 1:
            node = frame.can_id - frames.HEARTBEAT_BASE
            if 1 <= node <= 127:
                heard[node] = frame.data[0]
    if platform.canopen.master_node in heard:
        text = f"a heartbeat of node {platform.canopen.master_node}, which is the host's"
        yield Finding("other hosts", "fail", text, "stop the other driver, or change canopen.master_node")
    strangers = sorted(heard.keys() - known - {platform.canopen.master_node})
    if strangers:
        states = ", ".join(f"{node} ({_state(heard[node])})" for node in strangers)
        advice = "add them to valves, or see that they are meant to be there"
        yield Finding("other nodes", "warn", f"not in the platform: {states}", advice)
    # After an orderly end nodes are stopped, and answer nothing but network management.
    stopped = [node for node in sorted(known & heard.keys()) if heard[node] & 0x7F == NmtState.STOPPED]
    link.send([frames.nmt(NmtCommand.PRE_OPERATIONAL, node) for node in stopped])


def _state(value: int) -> str:
    try:
        return NmtState(value & 0x7F).name.lower().replace("_", "-")
    except ValueError:
        return f"0x{value:02X}"


def _ask(platform: CanopenPlatform, device: Device, client: SdoClient, node: int) -> Finding:
    name = f"node {node}"
    start = time.monotonic()
    try:
        startup.wait_for_boot(client, min(platform.canopen.boot_timeout_s, 1.0))
        kind, vendor, product = startup.check_identity(client, platform, device)
        scale = startup.read_scaling(client, platform, device, 0)
        status = device.find("status", 0)
        state = "" if status is None else cia408.state_of(client.read(status.index, status.sub)).value[0]
    except HardwareError as error:
        return Finding(name, "fail", str(error), _DO.get(client.step, "see the device's manual"))
    took_ms = 1e3 * (time.monotonic() - start)
    found = (
        f"profile {kind & 0xFFFF}, vendor 0x{vendor:X}, product 0x{product:X}, "
        f"{scale.setpoint_pa:g} Pa a count{f', {state}' if state else ''} ({took_ms:.0f} ms)"
    )
    return Finding(name, "ok", found)
