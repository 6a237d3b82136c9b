"""Error counters on the emulated bus."""

from hardware_bench import platform
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_hardware.emulation.canopen.hub import ErrorCounters, Hub
from soro_hardware.emulation.canopen.world import emulate
from soro_hardware.transport.frame import Frame


@settings(max_examples=200)
@given(st.lists(st.sampled_from("sStrRa"), max_size=400))
def test_error_counters_stay_in_their_bounds(events):
    counters = ErrorCounters()
    order = ["active", "warning", "passive", "bus_off"]
    for event in events:
        was_off, before = counters.is_off, counters.state
        {
            "s": counters.sent,
            "S": lambda: counters.sent(spoilt=True),
            "t": counters.reset,
            "r": counters.received,
            "R": lambda: counters.received(spoilt=True),
            "a": counters.unacknowledged,
        }[event]()
        assert 0 <= counters.transmit < 256 + 8
        assert 0 <= counters.receive <= 255
        assert not was_off or counters.is_off or event == "t", "only a reset leads back"
        assert abs(order.index(counters.state) - order.index(before)) <= 1 or event in "tr"


def test_spoilt_frames_are_sent_again_and_take_their_sender_off_the_bus():
    hub, heard, states = Hub(1_000_000), [], []
    sender = hub.attach(lambda *_: None)
    listener = hub.attach(lambda frame, now_ns: heard.append((frame.can_id, now_ns)))
    sender.report = lambda errors, letter: states.append((errors.state, letter))
    spoilt = iter("bb")
    hub.spoil = lambda frame, port: next(spoilt, "")
    hub.send(sender, Frame(0x181, bytes(4)), 0)
    hub.run(10**9)
    assert heard == [(0x181, (3 * 95 + 2 * 23) * 1000)], "at the third attempt, after two error frames"
    assert (sender.errors.transmit, listener.errors.receive) == (15, 1)
    hub.spoil = lambda frame, port: "b"
    hub.send(sender, Frame(0x181, bytes(4)), 10**9)
    hub.run(2 * 10**9)
    assert [state for state, _ in dict.fromkeys(states)] == ["active", "warning", "passive", "bus_off"]
    assert not hub.send(sender, Frame(0x181), 2 * 10**9)
    hub.spoil = lambda frame, port: ""
    sender.rejoin()
    hub.send(sender, Frame(0x182), 2 * 10**9)
    hub.run(3 * 10**9)
    assert [can_id for can_id, _ in heard] == [0x181, 0x182]


def test_an_adapter_without_cable_gets_passive_and_says_so():
    world = emulate(platform(), True, 0)
    adapter = world.lines[0]
    adapter.feed(b"O\r")
    world.host.plugged = False
    adapter.output.clear()
    for _ in range(20):
        adapter.feed(b"t0800\r")
    lines = bytes(adapter.output).split(b"\r")
    health = [line for line in lines if line.startswith(b"s")]
    assert health[0] == b"sa000008"
    assert b"sw000096" in health
    assert health[-1] == b"sp000128", "never off the bus by missing acknowledgement alone"
    assert lines.count(b"e1a") == len(health)
    adapter.feed(b"F\r")
    assert bytes(adapter.output).endswith(b"F24\r")


def test_an_adapter_off_the_bus_says_so_and_is_back_when_it_is_opened_anew():
    world = emulate(platform(), True, 0)
    adapter = world.lines[0]
    adapter.feed(b"O\r")
    adapter.output.clear()
    world.host.go_off()
    assert bytes(adapter.output) == b"sb000255\r"
    adapter.output.clear()
    adapter.feed(b"t0800\r")
    assert bytes(adapter.output) == b"\x07"
    adapter.feed(b"C\rO\r")
    adapter.output.clear()
    adapter.feed(b"t0800\r")
    assert bytes(adapter.output).startswith(b"z\r")
