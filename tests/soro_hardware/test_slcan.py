"""LAWICEL lines: good ones, every malformed case, seeded noise, a real pseudo-terminal, and unplugging."""

import os
import pickle
import random
import select
import threading
import tty
from concurrent.futures import ThreadPoolExecutor

import can
import numpy as np
import pytest
from hardware_bench import PATIENT, cycles_in_real_time, driver, emulator, platform, platform_file

from soro_core.errors import HardwareError
from soro_hardware.doctor import examine
from soro_hardware.emulation.canopen.adapter import (
    RememberingSlcanServer,
    SilentSlcanServer,
    SlcanServer,
)
from soro_hardware.transport.config import SlcanTransport
from soro_hardware.transport.frame import Frame, frame_bits
from soro_hardware.transport.slcan import SlcanBus
from soro_hardware.transport.slcan_codec import BusErrors, Health, Reply, SlcanDecoder, encode
from tests.refused import fails

EMPTY = len(pickle.dumps(SlcanDecoder()))  # of a decoder that stores nothing
GOOD = [
    (b"t1812AABB\r", Frame(0x181, b"\xaa\xbb")),
    (b"t1812aabb\r", Frame(0x181, b"\xaa\xbb")),
    (b"t7FF0\r", Frame(0x7FF)),
    (b"t00080102030405060708\r", Frame(0, bytes(range(1, 9)))),
    (b"T1FFFFFFF1FF\r", Frame(0x1FFFFFFF, b"\xff", extended=True)),
    (b"r1814\r", Frame(0x181, b"", remote=True, length=4)),
    (b"R000001811\r", Frame(0x181, b"", extended=True, remote=True, length=1)),
    (b"\r", Reply("")),
    (b"z\r", Reply("z")),
    (b"\x07", Reply("\x07")),
    (b"V1013\r", Reply("V1013")),
    (b"sb255255\r", Health("bus_off", 255, 255)),
    (b"sp128000\r", Health("passive", 128, 0)),
    (b"sw096001\r", Health("warning", 96, 1)),
    (b"sa000000\r", Health("active", 0, 0)),
    (b"e1a\r", BusErrors("a")),
    (b"e3bcs\r", BusErrors("bcs")),
]
STAMPED = [
    (b"t1812AABB1234\r", Frame(0x181, b"\xaa\xbb")),
    (b"t1810ea5f\r", Frame(0x181)),
    (b"T1FFFFFFF1FF0000\r", Frame(0x1FFFFFFF, b"\xff", extended=True)),
    (b"r18141234\r", Frame(0x181, b"", remote=True, length=4)),
]

GARBLED = {
    "bad hex": b"t1812AAGG\r",
    "byte that is not ASCII": b"t1812AA\xff\xfe\r",
    "cut off": b"t18161122\r",
    "cut off, with a space": b"t1816 1122\r",
    "two lines glued": b"t1812AABBt1822CCDD\r",
    "length 9": b"t1819112233445566778899\r",
    "identifier beyond 7FF": b"t8002AABB\r",
    "identifier beyond 29 bits": b"T200000002AABB\r",
    "half an identifier": b"t18\r",
    "underscore in the number": b"t1_12AABB\r",
    "sign in the number": b"t+182AABB\r",
    "half a time stamp": b"t1812AABB12\r",
    "five digits of a time stamp": b"t1812AABB12345\r",
    "time stamp and less data than its length": b"t1813AABB1234\r",
    "time stamp that is no number": b"t1812AABB12G4\r",
    "remote frame with data": b"r1812AABBCC\r",
    "health with letters": b"sbXXXYYY\r",
    "health too short": b"sb255\r",
    "unknown health": b"sx000000\r",
    "error count too high": b"e3a\r",
    "error code unknown": b"e1q\r",
    "line feed": b"\nt1812AABB\r",
    "NUL": b"\x00\r",
    "unknown letter": b"q\r",
    "line cut off by a refusal": b"t1812A\x07",
    "whole line, ended by a refusal": b"t1812AABB\x07",
    "overlong line": b"t" * 200 + b"\r",
}


@pytest.mark.parametrize(("line", "event"), GOOD + STAMPED, ids=[repr(line) for line, _ in GOOD + STAMPED])
def test_good_line(line, event):
    decoder = SlcanDecoder()
    assert decoder.feed(line) == [event]
    assert decoder.garbled == 0


@pytest.mark.parametrize(
    ("frame", "line"),
    [(event, line) for line, event in GOOD if isinstance(event, Frame) and b"a" not in line],
)
def test_encoding_is_the_reverse(frame, line):
    assert encode(frame) == line


@pytest.mark.parametrize("line", GARBLED.values(), ids=GARBLED.keys())
def test_garbled_line_is_counted_and_dropped(line):
    decoder = SlcanDecoder()
    events = decoder.feed(line)
    assert not [event for event in events if not isinstance(event, Reply)]
    assert decoder.garbled == 1
    assert decoder.feed(b"t1812AABB\r") == [Frame(0x181, b"\xaa\xbb")], "the next line must be read"


@pytest.mark.parametrize("size", [1, 2, 3, 7, 64])
def test_any_cut_into_chunks_gives_the_same(size):
    stream = b"".join(line for line, _ in GOOD) + GARBLED["overlong line"] + b"t1812AABB\r"
    whole, cut = SlcanDecoder(), SlcanDecoder()
    expected = whole.feed(stream)
    found = [event for at in range(0, len(stream), size) for event in cut.feed(stream[at : at + size])]
    assert (found, cut.garbled) == (expected, whole.garbled)


def test_line_that_never_ends():
    decoder = SlcanDecoder()
    for _ in range(1000):
        assert decoder.feed(b"t1812AABB" * 10) == []
        assert len(pickle.dumps(decoder)) < EMPTY + 100
    assert decoder.garbled == 1
    assert decoder.feed(b"\rt1812AABB\r") == [Frame(0x181, b"\xaa\xbb")]


def test_noise():
    """Nothing raises, nothing is stored without bound, and good frames come through between the noise."""
    noise = random.Random(408)
    decoder = SlcanDecoder()
    good = 0
    for _ in range(20_000):
        kind = noise.random()
        if kind < 0.4:
            chunk = noise.randbytes(noise.randrange(40))
        elif kind < 0.7:
            chunk = bytes(noise.choices(b"tTrRsezZ0123456789ABCDEFabcdef\r\x07 ", k=noise.randrange(40)))
        else:
            line = bytearray(encode(Frame(noise.randrange(0x800), noise.randbytes(noise.randrange(9)))))
            line[noise.randrange(len(line))] ^= 1 << noise.randrange(8)
            chunk = bytes(line)
        decoder.feed(chunk)
        decoder.feed(b"\r" * 2)  # end whatever is open
        good += decoder.feed(b"t1234DEADBEEF\r") == [Frame(0x123, b"\xde\xad\xbe\xef")]
        assert len(pickle.dumps(decoder)) < EMPTY + 100
    assert good == 20_000
    assert decoder.garbled > 5_000


@pytest.mark.parametrize(
    ("frame", "bits"),
    [
        (Frame(0x80), 55),
        (Frame(0x181, bytes(4)), 95),
        (Frame(0x181, bytes(6)), 115),
        (Frame(0x181, bytes(8)), 135),
        (Frame(0x181, bytes(8), extended=True), 160),
    ],
)
def test_bits_on_the_wire(frame, bits):
    """Worst case of ISO 11898: 12 cycles of RPDO, SYNC, 12 TPDO of 4 bytes are 2335 bits."""
    assert frame_bits(frame) == bits


# Time stamps off, frames without being asked for, acceptance code and mask of every frame.
FORGET = b"Z0\rX1\rM00000000\rmFFFFFFFF\r"


class Adapter:
    """A pseudo-terminal whose adapter end is played by the test."""

    def __init__(self):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.path = os.ttyname(self.slave)

    def answer(self, answer):
        os.write(self.master, answer)

    def read(self, size):
        """Exactly so many bytes from the host."""
        data = b""
        while len(data) < size:
            assert select.select([self.master], [], [], 5.0)[0], data
            data += os.read(self.master, size - len(data))
        return data

    def open(self):
        """Play an adapter that is opened; in a thread, since the host waits for the answers."""
        opening = self.read(7)
        self.answer(b"\r")
        opening += self.read(len(FORGET))
        self.answer(b"\r\x07\r\x07")  # it knows two of the four
        opening += self.read(2)
        self.answer(b"\r")
        assert opening == b"C\rC\rS8\r" + FORGET + b"O\r"

    def close(self):
        for descriptor in (self.master, self.slave):
            os.close(descriptor)
        self.master = self.slave = -1


@pytest.fixture
def adapter():
    adapter = Adapter()
    yield adapter
    if adapter.master >= 0:
        adapter.close()


@pytest.fixture
def bus(adapter):
    with ThreadPoolExecutor() as pool:
        opened = pool.submit(adapter.open)
        bus = SlcanBus(adapter.path, 1_000_000)
        opened.result()
    yield bus
    bus.shutdown()


def test_bus_is_a_python_can_bus(bus, adapter):
    bus.send(can.Message(arbitration_id=0x123, data=b"\x01\x02", is_extended_id=False))
    bus.send(can.Message(arbitration_id=0x18FF0001, is_extended_id=True, is_remote_frame=True, dlc=3))
    assert adapter.read(21) == b"t12320102\rR18FF00013\r"
    adapter.answer(b"z\rt1812AABB\rr7014\r")
    first, second = bus.recv(1.0), bus.recv(1.0)
    assert (first.arbitration_id, bytes(first.data), first.is_extended_id) == (0x181, b"\xaa\xbb", False)
    assert (second.arbitration_id, second.is_remote_frame, second.dlc) == (0x701, True, 4)
    assert bus.recv(0.0) is None


def test_bus_filters(bus, adapter):
    bus.set_filters([{"can_id": 0x180, "can_mask": 0x780}])
    adapter.answer(b"t7010\rt1810\r")
    assert bus.recv(1.0).arbitration_id == 0x181


@pytest.mark.parametrize("line", GARBLED.values(), ids=GARBLED.keys())
def test_bus_survives_garbage(bus, adapter, line):
    adapter.answer(line + b"t1812AABB\r")
    assert bus.recv(1.0).arbitration_id == 0x181
    assert bus.frames_garbled == 1


def test_bus_health(bus, adapter):
    assert bus.state is can.BusState.ACTIVE
    adapter.answer(b"sp128000\rt1810\r")
    bus.recv(1.0)
    assert bus.state is can.BusState.PASSIVE
    adapter.answer(b"e2ab\rsb255255\r\x07t1810\r")
    bus.recv(1.0)
    assert bus.state is can.BusState.ERROR
    assert bus.bus_errors == {"a": 1, "b": 1}
    assert bus.frames_refused == 1


def test_unplugged_adapter_raises_at_once(bus, adapter):
    adapter.close()
    with fails(HardwareError, code="gone"):
        bus.recv(1.0)
    with fails(HardwareError, code="gone"):
        bus.send(can.Message(arbitration_id=1, is_extended_id=False))


def test_frames_before_the_plug_was_pulled_are_still_read(bus, adapter):
    adapter.answer(b"t1810\r")
    adapter.close()
    with fails(HardwareError, code="gone"):
        [bus.recv(1.0) for _ in range(3)]


def test_no_port():
    with fails(HardwareError, device="/dev/none", code="open"):
        SlcanBus("/dev/none", 1_000_000)


def test_adapter_that_refuses_to_open(adapter):
    with ThreadPoolExecutor() as pool:
        pool.submit(lambda: adapter.read(7) and adapter.answer(b"\x07"))
        with fails(HardwareError, "S8", device=adapter.path, code="refused"):
            SlcanBus(adapter.path, 1_000_000)


def test_port_without_adapter(adapter):
    with fails(HardwareError, "S8", "transport.acknowledges: false", device=adapter.path, code="silent"):
        SlcanBus(adapter.path, 1_000_000, timeout_s=0.1)


# -- adapters that never acknowledge ---------------------------------------------------------------

STOCK = b"b158aa7 https://github.com/normaldotcom/canable-fw.git\r"


def test_an_adapter_that_answers_only_v_is_recognised(adapter):
    with ThreadPoolExecutor() as pool:
        played = pool.submit(lambda: (adapter.read(9), adapter.answer(STOCK), adapter.read(5)))
        bus = SlcanBus(adapter.path, 1_000_000)
        assert played.result()[0] == b"C\rC\rS8\rV\r"
        assert played.result()[2] == b"Z0\rO\r", "no more: canable2-fw takes X for a frame to send"
    assert not bus.acknowledges
    bus.send(can.Message(arbitration_id=0x123, is_extended_id=False))
    assert adapter.read(6) == b"t1230\r"
    adapter.answer(b"t1810\r")
    assert bus.recv(1.0).arbitration_id == 0x181
    assert bus.frames_garbled == 0
    bus.shutdown()


@pytest.mark.parametrize("late", [b"\r", b"\rV1013\r", b"\r\x07"])
def test_an_adapter_that_acknowledges_late_is_not_taken_for_a_silent_one(adapter, late):
    with ThreadPoolExecutor() as pool:
        pool.submit(
            lambda: (
                adapter.read(9),
                adapter.answer(late),
                adapter.read(len(FORGET)),
                adapter.answer(b"\x07" * 4),
                adapter.read(2),
                adapter.answer(b"\r"),
            )
        )
        bus = SlcanBus(adapter.path, 1_000_000)
    assert bus.acknowledges
    bus.shutdown()


def test_refusals_of_a_late_adapter_are_errors(adapter):
    with ThreadPoolExecutor() as pool:
        pool.submit(lambda: (adapter.read(9), adapter.answer(b"\x07")))
        with fails(HardwareError, "S8", code="refused"):
            SlcanBus(adapter.path, 1_000_000)


def test_told_to_be_silent_it_is_asked_nothing(adapter):
    bus = SlcanBus.from_transport(
        SlcanTransport(kind="slcan", device=adapter.path, acknowledges=False, open_timeout_s=0.1)
    )
    assert adapter.read(12) == b"C\rC\rS8\rZ0\rO\r"
    assert not bus.acknowledges
    bus.shutdown()


def test_told_to_acknowledge_it_is_not_asked_for_a_version(adapter):
    with fails(HardwareError, "S8", code="silent"):
        SlcanBus(adapter.path, 1_000_000, timeout_s=0.4, acknowledges=True)
    assert adapter.read(7) == b"C\rC\rS8\r"


# -- what an adapter remembers of its last owner ----------------------------------------------------


class Played:
    """An adapter in a thread that answers each command, as a table says; the others with `other`."""

    def __init__(self, adapter, answers, other=b"\x07"):
        self.commands = []
        self._adapter, self._answers, self._other = adapter, answers, other
        self._thread = threading.Thread(target=self._play)
        self._thread.start()

    def _play(self):
        while self.commands[-1:] != [b"O"]:
            command = b"".join(iter(lambda: self._adapter.read(1), b"\r"))
            self.commands.append(command)
            self._adapter.answer(self._answers.get(command, self._other))

    def join(self):
        self._thread.join(10.0)
        return self.commands


ANSWERS = {b"C": b"\r", b"S8": b"\r", b"O": b"\r"}
OWNERS = {
    "an old one, which knows nothing of them": {},
    "one that says nothing to what it does not know": {
        b"Z0": b"",
        b"X1": b"",
        b"M00000000": b"",
        b"mFFFFFFFF": b"",
    },
    "open and busy, with time stamps": {b"C": b"t1812AABB1234\rt1812AABB1235\r\r"},
    "closed already": {b"C": b"\x07"},
    "one that knows all of them": {b"Z0": b"\r", b"X1": b"\r", b"M00000000": b"\r", b"mFFFFFFFF": b"\r"},
}


@pytest.mark.parametrize("owner", OWNERS.values(), ids=OWNERS.keys())
def test_an_adapter_in_whatever_state_its_last_owner_left(adapter, owner):
    played = Played(adapter, ANSWERS | owner)
    bus = SlcanBus(adapter.path, 1_000_000)
    commands = played.join()
    assert b"Z0" in commands[: commands.index(b"O")], "while the bus is closed"
    assert bus.acknowledges
    adapter.answer(b"t1812aabb0001\rt1822CCDD\r")  # the time stamps that it did not switch off
    assert [bus.recv(1.0).arbitration_id for _ in range(2)] == [0x181, 0x182]
    assert (bus.frames_garbled, bus.frames_refused) == (0, 0)
    bus.shutdown()


def test_an_adapter_that_repeats_what_it_is_sent(adapter):
    echoes = {command: command + b"\r" + answer for command, answer in ANSWERS.items()}
    played = Played(adapter, echoes)
    with fails(HardwareError, "repeats", device=adapter.path, code="setting"):
        SlcanBus(adapter.path, 1_000_000)
    os.write(adapter.slave, b"O\r")  # ends the played one
    played.join()


@pytest.mark.process
def test_valves_behind_an_adapter_with_time_stamps(tmp_path):
    """It has them on and delivers frames only when asked, as its last owner left it."""
    path = platform_file(tmp_path, emulation={"adapters": ["slcan_remembering"]})
    with (
        emulator(tmp_path, platform=path) as served,
        driver(platform(**PATIENT), served.device, lockstep=False) as regulator,
    ):
        results = cycles_in_real_time(regulator, 0.5, np.array([20e3, 40e3, 60e3]))
        assert not [fault for result in results for fault in result.faults if fault.latched]
        assert regulator.statistics.frames_refused == regulator.statistics.frames_garbled == 0


REMEMBERING = [
    (b"C\rO\r", b"\r\r", b""),
    (b"C\rX1\rO\r", b"\r\r\r", b"t18110004D2\r"),
    (b"C\rX1\rZ0\rO\r", b"\r\r\r\r", b"t181100\r"),
    (b"C\rX1\rZ1\rO\rZ0\r", b"\r\r\r\r\x07", b"t18110004D2\r"),
]


@pytest.mark.parametrize(("commands", "answers", "frame"), REMEMBERING)
def test_emulated_adapter_that_remembers(commands, answers, frame):
    server = RememberingSlcanServer(lambda frame: True)
    server.feed(commands)
    assert bytes(server.output) == answers
    server.output.clear()
    server.deliver(Frame(0x181, b"\0"), (60_000 + 1234) * 1_000_000)
    assert bytes(server.output) == frame


@pytest.mark.process
def test_lockstep_needs_acknowledgements(tmp_path):
    path = platform_file(tmp_path, emulation={"adapters": ["slcan_silent"]})
    with (
        emulator(tmp_path, "--lockstep", platform=path) as served,
        fails(HardwareError, "lockstep", device=str(served.device), code="setting"),
        driver(platform(), served.device),
    ):
        pass


@pytest.mark.process
def test_valves_behind_a_silent_adapter(tmp_path):
    """Start-up, cycles and shutdown, and what the doctor says of it."""
    path = platform_file(tmp_path, emulation={"adapters": ["slcan_silent"]})
    with emulator(tmp_path, platform=path) as served:
        with driver(platform(**PATIENT), served.device, lockstep=False) as regulator:
            results = cycles_in_real_time(regulator, 0.5, np.array([20e3, 40e3, 60e3]))
            assert not [fault for result in results for fault in result.faults if fault.latched]
            np.testing.assert_allclose(results[-1].pressure_pa, [20e3, 40e3, 60e3], atol=2e3)
            assert regulator.statistics.frames_refused == regulator.statistics.frames_garbled == 0
        findings = {f.name: f for f in examine(platform(), str(served.device), run_s=0.0)}
    assert findings["acknowledgement"].level == "warn"
    assert findings["node 1"].level == "ok"


SILENT = [
    (b"S8\rO\rt1230\r", b"", 1),
    (b"O\rt1230\r\r\r", b"", 3),  # an empty line repeats the last command
    (b"V\r", STOCK, 0),
    (b"t1230\r", b"", 0),
    (b"O\rt123\r", b"", 0),
]


@pytest.mark.parametrize(("command", "answer", "frames"), SILENT, ids=[repr(c[0]) for c in SILENT])
def test_emulated_silent_adapter(command, answer, frames):
    sent = []
    server = SilentSlcanServer(lambda frame: sent.append(frame) is None)
    server.feed(command)
    assert bytes(server.output) == answer
    assert len(sent) == frames


COMMANDS = [
    (b"\r", b""),
    (b"C\r", b"\r"),
    (b"S8\r", b"\r"),
    (b"S9\r", b"\x07"),
    (b"S\r", b"\x07"),
    (b"V\r", b"V1013\r"),
    (b"N\r", b"NA408\r"),
    (b"F\r", b"\x07"),
    (b"t1230\r", b"\x07"),
    (b"Q\r", b"\x07"),
    (b"Z0\r", b"\x07"),
    (b"O\rt12301234\r", b"\r\x07"),  # a host sends no time stamps
    (b"O\rF\r", b"\rF00\r"),
    (b"O\rO\r", b"\r\r"),
    (b"O\rS8\r", b"\r\x07"),
    (b"O\rt1230\r", b"\rz\r"),
    (b"O\rT000001230\r", b"\rZ\r"),
    (b"O\rr1230\r", b"\rz\r"),
    (b"O\rt12301\r", b"\r\x07"),
    (b"L\rt1230\r", b"\r\x07"),
    (b"x" * 500 + b"\r", b"\x07"),
    (b"C\rS6\r\rO\rO\r", b"\r\r\r\r"),  # what python-can sends when it opens
]


@pytest.mark.parametrize(("command", "answer"), COMMANDS, ids=[repr(c)[:24] for c, _ in COMMANDS])
def test_emulated_adapter(command, answer):
    sent = []
    server = SlcanServer(lambda frame: sent.append(frame) is None)
    server.feed(command)
    assert bytes(server.output) == answer
    assert len(sent) == answer.lower().count(b"z")


def test_emulated_adapter_keeps_a_bounded_output():
    server = SlcanServer(lambda frame: True)
    server.feed(b"O\r")
    for _ in range(10_000):
        server.deliver(Frame(0x181, bytes(8)), 0)
    assert len(server.output) < 66_000
    assert server.overruns > 0
    server.feed(b"C\r")
    assert bytes(server.output) == b"\r"
