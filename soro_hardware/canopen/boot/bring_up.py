"""Start-up of all nodes: boot, errors of an earlier session, configuration, HOLD at 0, watchdogs.

The host sends heartbeats or guarding requests during the start-up, and stops them before the devices start to
watch for them. Each watchdog starts with the first message that it watches, so that a configured arm may wait
for its first exchange for any time.
"""

from __future__ import annotations

from soro_hardware.canopen.boot import startup, watchdogs
from soro_hardware.canopen.boot.valve_states import to_hold
from soro_hardware.canopen.config import CanopenPlatform
from soro_hardware.canopen.device import Device
from soro_hardware.canopen.frames import NmtCommand, NmtState
from soro_hardware.canopen.monitor import NodeMonitor
from soro_hardware.canopen.node_bus import NodeBus
from soro_hardware.canopen.sdo_client import SdoClient


def bring_up(bus: NodeBus, platform: CanopenPlatform, device: Device) -> None:
    """Start all nodes.

    Parameters
    ----------
    bus : NodeBus
        Link and nodes.
    platform : CanopenPlatform
        Valves and times.
    device : Device
        Kind of device.

    Raises
    ------
    HardwareError
        If a step fails; the message states the device and the step.
    """
    nodes = [(node, bus.client(node)) for node in bus.nodes]
    # A node that still runs from an earlier session stops its PDOs, and vents.
    bus.command(NmtCommand.PRE_OPERATIONAL, *bus.nodes)
    with bus:
        bus.beat()
        for _, client in nodes:
            startup.wait_for_boot(client, platform.canopen.boot_timeout_s)
        for node, client in nodes:
            _clear_errors(bus, platform, node, client)
        for node, client in nodes:
            _configure(platform, device, node, client)
        _start(bus, platform, device, nodes)
    for _, client in nodes:
        watchdogs.arm(client, platform, device)


def _clear_errors(bus: NodeBus, platform: CanopenPlatform, node: NodeMonitor, client: SdoClient) -> None:
    """Reset the communication of a node with a communication error, or with a watch of SYNC.

    Only this reset ends the error of a missed set point deadline. It also stops a watch of SYNC from an
    earlier session, which has to start again with the first SYNC.
    """
    times = platform.canopen
    if not watchdogs.has_communication_error(client) and times.sync_period_s is None:
        return
    client.step = "reset of the communication"
    boots = node.boots
    bus.command(NmtCommand.RESET_COMMUNICATION, node)
    if not bus.wait_for(lambda: node.boots > boots, times.boot_timeout_s):
        raise client.error(f"no boot-up message for {times.boot_timeout_s:g} s", "silent")
    bus.command(NmtCommand.PRE_OPERATIONAL, node)  # a device may start by itself
    startup.wait_for_boot(client, times.boot_timeout_s)


def _configure(platform: CanopenPlatform, device: Device, node: NodeMonitor, client: SdoClient) -> None:
    node.configured = True  # from now on a boot-up message is a fault
    channels = tuple(channel.channel for channel in node.channels)
    scalings = startup.configure_node(client, node.node, channels, platform, device)
    for channel, scaling in zip(node.channels, scalings, strict=True):
        channel.scaling = scaling


def _start(
    bus: NodeBus, platform: CanopenPlatform, device: Device, nodes: list[tuple[NodeMonitor, SdoClient]]
) -> None:
    """NMT start and HOLD; a device that reports its state has to report OPERATIONAL.

    The nodes start in sequence: the periods of heartbeats and events may count from the start of a node, and
    the messages of all nodes at once would not fit into a cycle.
    """
    for node, client in nodes:
        node.state = None
        bus.command(NmtCommand.START, node)
        for channel in node.channels:
            to_hold(client, device, channel.channel, platform.canopen.activation_timeout_s)
    if device.has_producer or device.is_guarded:
        bus.beat()  # with the requests to guarded nodes
        for node, client in nodes:
            _confirm(bus, platform, node, client)
    for node in bus.nodes:
        node.started()


def _confirm(bus: NodeBus, platform: CanopenPlatform, node: NodeMonitor, client: SdoClient) -> None:
    """Wait until the node reports OPERATIONAL."""
    times = platform.canopen
    limit_s = max(times.activation_timeout_s, 2 * times.heartbeat_s)
    if bus.wait_for(lambda: node.state == NmtState.OPERATIONAL, limit_s):
        return
    register = watchdogs.error_register(client)
    client.step = "NMT start"
    found = "reports no state" if node.state is None else f"is in communication state 0x{node.state:02X}"
    raise client.error(f"the node does not stay OPERATIONAL: it {found}, error register 0x{register:02X}")
