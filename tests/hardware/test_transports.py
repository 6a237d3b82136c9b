"""Ways to a CAN bus: by name, over TCP, errors in one line, a bus that is lost and found again."""

import errno
import socket
import threading
import time

import can
import numpy as np
import pytest
from hardware_bench import PERIOD_NS, Bench, codes, driver, emulator, platform, platform_file
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.errors import ConfigError, HardwareError
from soro_core.hardware import load_platform, open_regulator
from soro_core.hardware.emulation.error_counters import ErrorCounters
from soro_core.hardware.emulation.hub import Hub
from soro_core.hardware.emulation.world import emulate
from soro_core.hardware.transport.error_frames import BUS_OFF, CONTROLLER, NO_ACKNOWLEDGE, RESTARTED, letters
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.link import CanLink
from soro_core.hardware.transport.open import open_bus
from soro_core.hardware.transport.reconnect import Reconnect
from soro_core.hardware.transport.slcan import SlcanBus
from soro_core.hardware.transport.socketcand import SocketcandBus
from soro_core.hardware.transport.socketcand_codec import (
    Decoder,
    WireError,
    Word,
    encode_error,
    encode_frame,
    encode_send,
)

TARGET = np.array([20e3, 40e3, 60e3])
SOCKETCAND = {"transport": {"kind": "socketcand"}}


def of(kind, **keys):
    return platform(transport={"kind": kind, **keys}).transport


# Configuration ------------------------------------------------------------------------------------


def test_shipped_socketcan_platform():
    shipped = load_platform("canopen_socketcan")
    assert (shipped.transport.kind, shipped.device) == ("socketcan", "can0")


BAD = {
    "unknown kind": ({"kind": "usb"}, "transport.kind: got 'usb'; allowed: one of 'slcan', 'socketcan', "),
    "no kind": ({"kind": None}, "transport"),
    "unknown key": (
        {"kind": "socketcan", "channel": "can0", "baud": 1},
        "transport.baud: got 'an unknown key'; allowed: bitrate, open_timeout_s, kind, channel",
    ),
    "no interface": ({"kind": "python_can", "channel": "x"}, "transport.interface: got 'nothing'"),
    "port": ({"kind": "socketcand", "port": 0}, "transport.port: got 0"),
    "bit rate": ({"kind": "socketcan", "channel": "can0", "bitrate": 3}, "transport.bitrate: got 3"),
}


@pytest.mark.parametrize(("transport", "text"), BAD.values(), ids=BAD.keys())
def test_bad_transport(transport, text):
    with pytest.raises(ConfigError) as caught:
        platform(transport=transport)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


# Opening ------------------------------------------------------------------------------------------

KERNEL = {
    errno.ENODEV: "socketcan can0: no such network interface",
    errno.EAFNOSUPPORT: "this kernel has no CAN sockets: load the modules can and can_raw",
    errno.ENETDOWN: "`sudo ip link set can0 up type can bitrate 500000`",
    errno.EPERM: "no permission",
    errno.EIO: "Input/output error",
}


@pytest.mark.parametrize(("number", "text"), KERNEL.items(), ids=[errno.errorcode[n] for n in KERNEL])
def test_kernel_errors_say_what_to_do(number, text, monkeypatch):
    def refuse(**_):
        raise OSError(number, {errno.EIO: "Input/output error"}.get(number, "x"))

    monkeypatch.setattr(can, "Bus", refuse)
    with pytest.raises(HardwareError) as caught:
        open_bus(of("socketcan", channel="can0", bitrate=500_000))
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_package_of_an_interface(monkeypatch):
    def refuse(**_):
        raise can.CanInterfaceNotImplementedError("no module named 'usb'")

    monkeypatch.setattr(can, "Bus", refuse)
    with pytest.raises(HardwareError, match="gs_usb 0: its driver or Python package is missing"):
        open_bus(of("python_can", interface="gs_usb", channel=0))


def test_absent_interface_of_this_machine():
    """Whatever this kernel has: one line, no traceback of another kind."""
    regulator = open_regulator(platform(transport={"kind": "socketcan", "channel": "none9"}))
    with pytest.raises(HardwareError, match=r"^socketcan none9: "):
        regulator.configure()


def test_unknown_interface_names_the_known_ones():
    with pytest.raises(HardwareError, match=r"python-can has no interface 'canbus'; it knows .*socketcan"):
        open_bus(of("python_can", interface="canbus", channel="0"))


def test_any_python_can_interface_by_name():
    transport = of(
        "python_can", interface="virtual", channel="soro-test", options={"receive_own_messages": False}
    )
    other = can.Bus(interface="virtual", channel="soro-test")
    link = CanLink(lambda: open_bus(transport))
    link.open()
    link.send([Frame(0x181, b"\x01\x02")])
    assert other.recv(1.0).data == b"\x01\x02"
    other.send(can.Message(arbitration_id=0x201, data=b"\x03", is_extended_id=False))
    assert link.receive(1.0) == Frame(0x201, b"\x03")
    link.close()
    other.shutdown()


class ErrorBus(can.BusABC):
    """A bus that has error frames of the kernel to give."""

    def __init__(self, *messages):
        self.channel_info, self._messages, self._is_shutdown = "errors", list(messages), True

    def send(self, msg, timeout=None):
        """Take it."""

    def recv(self, timeout=None):
        return self._messages.pop(0) if self._messages else None


def error_frame(classes, data=bytes(8)):
    return can.Message(arbitration_id=classes, is_error_frame=True, is_extended_id=True, data=data)


def test_error_frames_of_the_kernel_are_counted_and_tell_of_bus_off():
    frame = can.Message(arbitration_id=0x181, data=b"\x01", is_extended_id=False)
    bus = ErrorBus(error_frame(NO_ACKNOWLEDGE), frame, error_frame(BUS_OFF))
    link = CanLink(lambda: bus)
    link.open()
    assert link.receive(0.0) == Frame(0x181, b"\x01")
    assert not link.is_bus_off
    assert link.receive(0.0) is None
    assert link.is_bus_off
    assert link.counts["errors"] == 2
    bus._messages.append(error_frame(RESTARTED))
    link.receive(0.0)
    assert not link.is_bus_off
    assert letters(CONTROLLER, b"\x00\x01") == "o"


def test_full_queue_of_the_kernel_is_waited_for_but_not_for_ever():
    class Full(ErrorBus):
        tries = 0

        def send(self, msg, timeout=None):
            self.tries += 1
            if self.tries <= self.full:
                raise can.CanOperationError("No buffer space available", error_code=errno.ENOBUFS)

    bus = Full()
    link = CanLink(lambda: bus)
    link.open()
    bus.full = 5
    link.send([Frame(0x201)])
    assert (bus.tries, link.sent) == (6, 1)
    bus.full = 10**6
    with pytest.raises(HardwareError, match=r"sending failed .*No buffer space"):
        link.send([Frame(0x201)])


# socketcand ---------------------------------------------------------------------------------------

FRAMES = st.builds(
    lambda can_id, data, extended: Frame(can_id if extended else can_id & 0x7FF, data, extended),
    st.integers(0, 0x1FFFFFFF),
    st.binary(max_size=8),
    st.booleans(),
)


@given(FRAMES)
def test_socketcand_round_trip(frame):
    assert Decoder().feed(encode_send(frame)) == [frame]
    assert Decoder().feed(encode_frame(frame, 12_345_678_901)) == [frame]


@given(st.binary(max_size=400), st.lists(st.integers(1, 50), max_size=20))
def test_no_bytes_break_the_decoder(data, cuts):
    decoder = Decoder()
    for cut in cuts:
        decoder.feed(data[:cut])
        data = data[cut:]
    decoder.feed(data)
    decoder.feed(b">" * 2)
    garbled = decoder.garbled
    assert decoder.feed(b"< frame 181 1.000000 0102 >")[-1:] == [Frame(0x181, b"\x01\x02")]
    assert decoder.garbled == garbled


def test_socketcand_lines():
    assert encode_send(Frame(0x201, b"\x07\x00\xd0\x07")) == b"< send 201 4 7 0 D0 7 >"
    assert encode_frame(Frame(0x181, b"\x0f\x01"), 1_500_000) == b"< frame 181 0.001500 0F01 >"
    decoder = Decoder()
    assert decoder.feed(b"< hi >< o") == [Word("hi")]
    assert decoder.feed(b"k >" + encode_error(BUS_OFF, 0)) == [Word("ok"), WireError(BUS_OFF)]
    assert decoder.garbled == 0
    for bad in (b"< frame 8FF 1.0 00 >", b"< frame 181 1.0 0 >", b"noise< ok >", b"< \xff >", b"x" * 300):
        before = decoder.garbled
        decoder.feed(bad)
        assert decoder.garbled == before + 1, bad


def test_driver_over_socketcand_is_the_driver_over_slcan(tmp_path):
    bench = Bench(platform(), seed=4)
    bench.driver.configure()
    path = platform_file(tmp_path, **SOCKETCAND)
    with emulator(tmp_path, "--lockstep", "--seed", "4", platform=path) as served:
        address = served.ready.removeprefix("ready: ")
        assert address.startswith("127.0.0.1:")
        with driver(platform(**SOCKETCAND), address) as regulator:
            assert isinstance(regulator._link._bus, SocketcandBus)
            for cycle in range(100):
                ours = bench.exchange(*TARGET)
                theirs = regulator.exchange(TARGET, cycle * PERIOD_NS)
                np.testing.assert_array_equal(ours.pressure_pa, theirs.pressure_pa)
            assert regulator.statistics.frames_garbled == 0


def test_several_adapters_on_one_bus(tmp_path):
    """A second adapter hears what the first one's host and the devices say; the driver takes either."""
    path = platform_file(tmp_path, emulation={"adapters": ["slcan", "socketcand"]})
    with emulator(tmp_path, "--lockstep", platform=path) as served:
        pty, address = served.ready.removeprefix("ready: ").split(",")
        listener = open_bus(of("slcan"), address)
        with driver(platform(), pty) as regulator:
            assert isinstance(regulator._link._bus, SlcanBus)
            assert regulator.exchange(TARGET, 0).faults == ()
            heard = set()
            while frame := listener.recv_frame(0.2):
                heard.add(frame.can_id)
            assert {0x080, 0x181, 0x183, 0x201, 0x602, 0x77F} <= heard
        listener.shutdown()


def test_socketcand_server_that_goes_is_noticed_in_the_next_cycle(tmp_path):
    path = platform_file(tmp_path, **SOCKETCAND)
    regulator = open_regulator(platform(**SOCKETCAND), None, lockstep=True)
    with pytest.raises(HardwareError, match="no server named"):
        regulator.configure()
    with emulator(tmp_path, "--lockstep", platform=path) as served:
        address = served.ready.removeprefix("ready: ")
        regulator = open_regulator(platform(**SOCKETCAND), address, lockstep=True)
        regulator.configure()
        regulator.exchange(TARGET, 0)
        served.process.kill()
        served.process.wait(10)
        with pytest.raises(HardwareError, match="the adapter is gone"):
            regulator.exchange(TARGET, PERIOD_NS)
        regulator.vent()
        with pytest.raises(HardwareError, match="no socketcand server answers"):
            regulator.configure()
        regulator.close()


class Impostor:
    """A TCP server that says what it is told to."""

    def __init__(self, *answers):
        self._server = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._server.getsockname()[1]}"
        self._answers = answers
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self):
        host, _ = self._server.accept()
        for answer in self._answers:
            host.sendall(answer)
            if host.recv(100) == b"":
                break
        host.close()

    def close(self):
        self._thread.join()
        self._server.close()


@pytest.mark.parametrize(
    ("answers", "text"),
    [
        ((b"< hi >", b"< error could not open bus >"), r"the server refused \(open can0\): error could not"),
        ((b"220 mail server ready\r\n",), r"the server did not answer \(greet\)"),
        ((b"< hi >",), "the adapter is gone"),
    ],
)
def test_what_is_no_socketcand_server(answers, text):
    impostor = Impostor(*answers)
    with pytest.raises(HardwareError, match=text):
        SocketcandBus.from_transport(of("socketcand", open_timeout_s=0.2), impostor.address)
    impostor.close()


def test_remote_frames_are_not_for_socketcand(tmp_path):
    with emulator(tmp_path, platform=platform_file(tmp_path, **SOCKETCAND)) as served:
        bus = open_bus(of("socketcand"), served.ready.removeprefix("ready: "))
        with pytest.raises(HardwareError, match="no remote frames"):
            bus.send_frames([Frame(0x701, b"", remote=True, length=1)])
        bus.shutdown()


# Error counters on the emulated bus ---------------------------------------------------------------


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


# A bus that is lost -------------------------------------------------------------------------------


class Clock:
    """Time in the hands of a test."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def lost(monkeypatch):
    """A running arm whose bus can be made to fail, and its clock."""
    bench = Bench(platform())
    clock = Clock()
    bench.driver._guard._clock = clock
    bench.driver.configure()
    bench.run(20, 20e3)
    monkeypatch.setattr(time, "sleep", lambda seconds: setattr(clock, "now", clock.now + seconds))
    return bench, clock


def go_off(bench, monkeypatch, off=True):
    state = can.BusState.ERROR if off else can.BusState.ACTIVE
    monkeypatch.setattr(type(bench.bus), "state", property(lambda self: state))


@pytest.mark.timeout(20)
def test_an_adapter_that_never_stops_giving_frames_is_given_up(lost, monkeypatch):
    """No bus carries so many; a server of frames, or a broken adapter, can."""
    bench, clock = lost
    with monkeypatch.context() as flood:
        flood.setattr(CanLink, "receive", lambda link, timeout_s: Frame(0x7FF, b"x"))
        bench.driver.vent()
        with pytest.raises(HardwareError, match="more frames than a bus can carry"):
            bench.exchange(20e3)
    clock.now += 20.0
    assert codes(bench.exchange(20e3)) == {("connection_lost", "bus")}


@pytest.mark.timeout(20)
def test_frames_of_others_without_end_do_not_lengthen_a_cycle_for_ever(lost, monkeypatch):
    bench, _ = lost
    bench.driver.platform = bench.driver.platform.model_copy(update={"lockstep_timeout_s": 0.1})
    drained = iter([None])
    with monkeypatch.context() as flood:
        flood.setattr(CanLink, "receive", lambda link, timeout_s: next(drained, Frame(0x7FF, b"x")))
        assert not bench.exchange(20e3).fresh.any()


def test_bus_off_is_opened_again_after_half_a_second_and_stays_silent(lost, monkeypatch):
    bench, clock = lost
    go_off(bench, monkeypatch)
    assert codes(bench.exchange(20e3)) == {("bus_off", "bus")}
    go_off(bench, monkeypatch, off=False)
    link = bench.driver._link
    assert not link.is_open
    clock.now += 0.4
    bench.exchange(20e3)
    assert not link.is_open
    clock.now += 0.2
    bench.bus.take_log()
    assert codes(bench.exchange(20e3)) == {("bus_off", "bus")}
    assert link.is_open
    bench.driver.vent()
    assert bench.bus.take_log() == [], "vented by their own watchdogs; nothing is sent before configure"
    bench.driver.configure()
    assert bench.run(100, 20e3).faults == ()


def test_a_bus_that_stays_off_is_tried_seldom_and_leaves_a_try_to_the_user(lost, monkeypatch):
    bench, clock = lost
    go_off(bench, monkeypatch)
    opened = []
    link = bench.driver._link
    link._open_bus = lambda: opened.append(clock.now) or bench.bus
    for _ in range(500):
        clock.now += 0.1
        bench.exchange(20e3)
    assert len(opened) == 1, "off again at once: two times off within a minute"
    go_off(bench, monkeypatch, off=False)
    bench.driver.configure()
    assert bench.run(5, 20e3).faults == ()


def test_bus_off_three_times_a_minute_is_enough(lost, monkeypatch):
    bench, clock = lost
    for _ in range(3):
        bench.driver.configure()
        go_off(bench, monkeypatch)
        bench.exchange(20e3)
        go_off(bench, monkeypatch, off=False)
        clock.now += 1.0
    with pytest.raises(HardwareError, match=r"off three times within a minute.* in 57 s"):
        bench.driver.configure()
    clock.now += 58.0
    bench.driver.configure()
    assert bench.run(5, 20e3).faults == ()


def test_broken_connection_raises_comes_back_and_stays_latched(lost, monkeypatch):
    bench, clock = lost
    link, working = bench.driver._link, bench.driver._link._open_bus

    def gone():
        raise HardwareError("adapter: cannot open")

    def unplugged(timeout=None):
        raise OSError(errno.EIO, "unplugged")

    monkeypatch.setattr(bench.bus, "recv", unplugged)
    link._open_bus = gone
    for _ in range(3):
        with pytest.raises(HardwareError, match="Input/output error; look at its cable"):
            bench.exchange(20e3)
    monkeypatch.undo()
    attempts = []
    link._open_bus = lambda: attempts.append(clock.now) or gone()
    for _ in range(400):
        clock.now += 0.1
        with pytest.raises(HardwareError):
            bench.exchange(20e3)
    pauses = np.diff(attempts)
    assert len(attempts) < 12
    assert pauses.max() <= 10.2
    assert np.all(np.diff(pauses) > -0.15), "longer and longer"
    link._open_bus = working
    clock.now += 20.0
    bench.bus.take_log()
    result = bench.exchange(20e3)
    assert codes(result) == {("connection_lost", "bus")}
    assert not result.sent_pa.any()
    assert bench.bus.take_log() == []
    bench.driver.configure()
    assert bench.run(5, 20e3).faults == ()


def test_devices_without_a_watchdog_are_sent_zeros_as_soon_as_the_bus_is_back(monkeypatch):
    """They have held their pressure meanwhile: nobody else takes it out."""
    scaling = {"kind": "fixed", "setpoint": {"pa_per_count": 10.0}, "reading": {"pa_per_count": 10.0}}
    mapping = {"device": "aventics_aes", "scaling": scaling}
    valves = [{"chamber": f"link0/chamber{n}", "node": 1, "channel": n} for n in range(3)]
    bench, clock = Bench(platform(valves=valves, canopen={"mapping": mapping})), Clock()
    bench.driver._guard._clock = clock
    bench.driver.configure()
    bench.run(100, 50e3)
    go_off(bench, monkeypatch)
    assert codes(bench.exchange(50e3)) == {("bus_off", "bus")}
    assert bench.world.pressure_pa.min() > 49e3
    go_off(bench, monkeypatch, off=False)
    clock.now += 0.6
    for _ in range(60):
        assert codes(bench.exchange(50e3)) == {("bus_off", "bus")}
    assert bench.world.pressure_pa.max() < 5e3
    bench.driver.configure()
    assert bench.run(5, 20e3).faults == ()


def test_reconnect_pauses():
    policy = Reconnect()
    assert policy.wait_s(0.0) == 0.0
    pauses = []
    for _ in range(7):
        policy.broken(0.0)
        pauses.append(policy.wait_s(0.0))
    assert pauses == [0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0]
    policy.opened()
    policy.healthy()
    policy.broken(0.0)
    assert policy.wait_s(0.0) == 0.5
