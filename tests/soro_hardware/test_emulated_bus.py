"""The emulated wire and the world around it: order, pacing, time."""

import numpy as np
from hardware_bench import Bench, platform, single, ticks

from soro_hardware.canopen import frames
from soro_hardware.canopen.cia408 import ValveState
from soro_hardware.canopen.frames import NmtCommand
from soro_hardware.emulation.canopen.hub import Hub
from soro_hardware.emulation.canopen.world import World
from soro_hardware.transport.frame import Frame

S = ValveState


def test_frames_are_carried_in_order_and_never_to_their_sender():
    hub = Hub(1_000_000)
    log = []
    a = hub.attach(lambda frame, time_ns: log.append(("a", frame.can_id, time_ns)))
    b = hub.attach(lambda frame, time_ns: log.append(("b", frame.can_id, time_ns)))
    hub.send(a, Frame(0x300), 0)
    hub.send(a, Frame(0x080), 0)
    hub.send(b, Frame(0x200), 0)
    hub.send(b, Frame(0x100), 60_000)
    hub.run(1_000_000)
    assert log == [("b", 0x300, 55_000), ("b", 0x080, 110_000), ("a", 0x200, 165_000), ("a", 0x100, 220_000)]


def test_bus_is_paced():
    """12 single valves need 2335 bits a cycle: 428 cycles a second are the most that 1 Mbit/s carries."""
    valves = [{"chamber": f"link0/chamber{n}", "node": n + 1} for n in range(12)]
    done = []
    world = World(
        platform(valves=valves, emulation={"boot_delay_s": 0.0}),
        lambda frame: done.append((world.now_ns, frame.can_id)),
        lockstep=False,
    )
    world.run(20_000_000)
    world.send(world.host, frames.nmt(NmtCommand.START, 0))
    world.run(21_000_000)
    for node in world.nodes:
        node.dictionary.values[0x1801, 1] |= 1 << 31
    done.clear()
    start = world.now_ns
    for n in range(1, 13):
        world.send(world.host, Frame(0x200 + n, bytes(4)))
    world.send(world.host, frames.SYNC)
    world.run(start + 10_000_000)
    assert [can_id for _, can_id in done] == list(range(0x181, 0x18D))
    assert done[-1][0] - start == 2_335_000


def test_full_transmit_queue_loses_frames():
    hub = Hub(10_000)
    port = hub.attach(lambda *_: None)
    for _ in range(300):
        hub.send(port, Frame(1, bytes(8)), 0)
    assert port.overruns == 300 - 256


def test_stalled_process_does_not_age_the_world():
    world = World(single(), lambda frame: None, lockstep=False)
    assert world.run(10_000_000) == 0
    assert world.run(5_000_000_000) == 4_970_000_000
    assert world.now_ns == 30_000_000


def test_real_time_world_publishes_each_step():
    world = World(single(), lambda frame: None, lockstep=False)
    published = []
    world.on_tick = lambda time_ns, pressures, _: published.append((time_ns, pressures.shape))
    for time_ms in range(1, 26):
        world.run(time_ms * 1_000_000)
    assert published == [(2_500_000 * n, (1,)) for n in range(1, 11)]


def test_lockstep_advances_by_a_cycle_whatever_period_was_written(powered):
    ticks(powered, 1)
    assert powered.world.now_ns == 5_000_000
    powered.sdo("23 06 10 00 50 C3 00 00")  # 50 ms
    ticks(powered, 1)
    assert powered.world.now_ns == 10_000_000


def test_readings_of_one_sync_belong_together():
    bench = Bench(platform(regulator={"reading_noise_pa": 0.0}))
    bench.driver.configure()
    for _ in range(50):
        before = bench.world.pressure_pa.copy()
        result = bench.exchange(20e3, 40e3, 60e3)
        np.testing.assert_allclose(result.pressure_pa, before, atol=51.0)
