"""Emulated nodes by themselves: SDO answers, mapping rules, PDOs."""

import pytest
from hardware_bench import emergencies, ticks

from soro_core.config import config_folder
from soro_hardware.canopen import frames, sdo_frames
from soro_hardware.canopen.cia408 import ValveState
from soro_hardware.canopen.eds import read_eds
from soro_hardware.canopen.frames import NmtCommand, NmtState
from soro_hardware.canopen.sdo_frames import SdoAbort
from soro_hardware.transport.frame import Frame

S = ValveState

SDO = {
    "read four bytes": ("40 00 10 00 00 00 00 00", "43 00 10 00 98 01 00 00"),
    "read two bytes": ("40 17 10 00 00 00 00 00", "4B 17 10 00 00 00 00 00"),
    "read one byte": ("40 80 63 02 00 00 00 00", "4F 80 63 02 22 00 00 00"),
    "read its serial number": ("40 18 10 04 00 00 00 00", "43 18 10 04 01 00 00 00"),
    "write": ("2B 17 10 00 64 00 00 00", "60 17 10 00 00 00 00 00"),
    "block download": ("C2 17 10 00 02 00 00 00", "80 17 10 00 01 00 04 05"),
    "segment of nothing": ("0B 64 00 00 00 00 00 00", "80 64 00 00 01 00 04 05"),
    "segmented download of a read-only object": ("21 41 60 00 02 00 00 00", "80 41 60 00 02 00 01 06"),
    "upload segment": ("60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"),
    "write to read-only": ("2B 41 60 00 00 00 00 00", "80 41 60 00 02 00 01 06"),
    "no object": ("40 00 20 00 00 00 00 00", "80 00 20 00 00 00 02 06"),
    "no sub-index": ("40 80 63 07 00 00 00 00", "80 80 63 07 11 00 09 06"),
    "length": ("2F 17 10 00 64 00 00 00", "80 17 10 00 10 00 07 06"),
    "too high": ("2F 43 60 00 05 00 00 00", "80 43 60 00 31 00 09 06"),
    "too low": ("2F 43 60 00 03 00 00 00", "80 43 60 00 32 00 09 06"),
    "reserved transmission type": ("2F 00 14 02 F5 00 00 00", "80 00 14 02 31 00 09 06"),
    "entry of a map in use": ("23 00 16 01 10 00 40 60", "80 00 16 01 22 00 00 08"),
    "count of a map in use": ("2F 00 16 00 00 00 00 00", "80 00 16 00 22 00 00 08"),
    "other identifier in use": ("23 00 14 01 05 02 00 00", "80 00 14 01 22 00 00 08"),
    "client's abort": ("80 00 10 00 00 00 04 05", ""),
}


@pytest.mark.parametrize(("request_", "answer"), SDO.values(), ids=SDO.keys())
def test_sdo(powered, request_, answer):
    assert powered.sdo(request_) == answer


def filled(data):
    """Eight bytes as hexadecimal text, with zeros at the end."""
    return f"{data}{' 00' * 8}"[:23]


# CiA 301 allows segments for objects of any size: 1017 (two bytes) in one, 1016:1 (four) in two.
DOWNLOADS = {
    "one segment": ([("21 17 10 00 02", "60 17 10 00"), ("0B 64", "20")], 100),
    "size not told": ([("20 17 10 00", "60 17 10 00"), ("0B 64", "20")], 100),
    "two segments": (
        [
            ("21 16 10 01 04", "60 16 10 01"),
            ("0A 64", "20"),
            ("1B 7F", "30"),
        ],
        127 << 16 | 100,
    ),
    "toggle": ([("21 17 10 00 02", "60 17 10 00"), ("1B 64 00", "80 17 10 00 00 00 03 05")], 0),
    "too long": ([("21 17 10 00 02", "60 17 10 00"), ("09 64 00 00", "80 17 10 00 10 00 07 06")], 0),
    "too long at last": ([("20 17 10 00", "60 17 10 00"), ("09 64", "80 17 10 00 10 00 07 06")], 0),
    "without end": (
        [
            ("20 17 10 00", "60 17 10 00"),
            ("00 64", "80 17 10 00 10 00 07 06"),
            ("40 17 10 00", "4B 17 10 00"),
        ],
        0,
    ),
    "another request between": (
        [("21 17 10 00 02", "60 17 10 00"), ("40 17 10 00", "80 17 10 00 01 00 04 05")],
        0,
    ),
    "client's abort between": (
        [
            ("21 17 10 00 02", "60 17 10 00"),
            ("80 17 10 00 00 00 04 05", ""),
            ("40 17 10 00", "4B 17 10 00"),
        ],
        0,
    ),
}


@pytest.mark.parametrize(("exchanged", "value"), DOWNLOADS.values(), ids=DOWNLOADS.keys())
def test_segmented_download(powered, exchanged, value):
    for request, answer in exchanged:
        assert powered.sdo(filled(request)) == (filled(answer) if answer else ""), request
    key = (0x1016, 1) if "16 10 01" in exchanged[0][0] else (0x1017, 0)
    assert powered.world.nodes[0].dictionary.values[key] == value


def test_a_client_that_has_gone_blocks_nobody(powered):
    powered.sdo(filled("21 17 10 00 02"))
    ticks(powered, 201)
    assert powered.sdo("40 17 10 00 00 00 00 00") == "4B 17 10 00 00 00 00 00"


def test_write_only_object_cannot_be_read(powered):
    dictionary = powered.world.nodes[0].dictionary
    entry = dictionary.entries[0x6040, 0]
    dictionary.entries = {
        **dictionary.entries,
        (0x6040, 0): type(entry)(**{**vars(entry), "readable": False}),
    }
    assert powered.sdo("40 40 60 00 00 00 00 00") == "80 40 60 00 01 00 01 06"


@pytest.mark.parametrize("index", ["94", "A0", "A1"])
def test_parameters_are_settable_in_init_only(running, index):
    assert running.sdo(f"2B {index} 63 01 00 00 00 00") == f"80 {index} 63 01 22 00 00 08"


def test_every_abort_code_has_a_name():
    assert sdo_frames.abort_text(SdoAbort.NO_OBJECT) == "0x06020000 no object"
    assert sdo_frames.abort_text(0x08000020) == "0x08000020"


@pytest.mark.parametrize(
    "eds", sorted((config_folder() / "canopen").glob("*.eds")), ids=lambda path: path.stem
)
def test_dictionary_is_that_of_the_eds(eds):
    text = eds.read_text()
    listed = {int(line[1:5], 16) for line in text.splitlines() if line.startswith("[") and line[5:6] in "]s"}
    entries = read_eds(eds, 5)
    assert {index for index, _ in entries} == listed
    assert entries[0x1800, 1].default == 0x185


OFF, CLEAR = "23 00 18 01 81 01 00 80", "2F 00 1A 00 00 00 00 00"
REMAP = {
    "entry before the count is 0": ([OFF, "23 00 1A 01 10 01 81 63"], "22 00 00 08"),
    "object that does not exist": ([OFF, CLEAR, "23 00 1A 01 10 00 99 63"], "00 00 02 06"),
    "object that is not mappable": ([OFF, CLEAR, "23 00 1A 01 10 01 94 63"], "41 00 04 06"),
    "wrong number of bits": ([OFF, CLEAR, "23 00 1A 01 08 01 81 63"], "41 00 04 06"),
    "count beyond the entries": ([OFF, CLEAR, "2F 00 1A 00 03 00 00 00"], "00 00 02 06"),
    "more than 64 bits": (
        [OFF, CLEAR, *(f"23 00 1A 0{n} 10 01 81 63" for n in range(1, 6)), "2F 00 1A 00 05 00 00 00"],
        "42 00 04 06",
    ),
    "reading mapped to be received": (
        ["23 00 14 01 01 02 00 80", "2F 00 16 00 00 00 00 00", "23 00 16 01 10 01 81 63"],
        "41 00 04 06",
    ),
}


@pytest.mark.parametrize(("requests", "abort"), REMAP.values(), ids=REMAP.keys())
def test_mapping_rules(powered, requests, abort):
    *before, last = [powered.sdo(request) for request in requests]
    assert all(answer.startswith("60") for answer in before)
    assert last.startswith("80")
    assert last.endswith(abort)


def test_remapped_pdo_is_sent(powered):
    """Reading first, then the status word, under another identifier."""
    for request in (
        OFF,
        CLEAR,
        "23 00 1A 01 10 01 81 63",
        "23 00 1A 02 10 00 41 60",
        "2F 00 1A 00 02 00 00 00",
        "23 00 18 01 A1 01 00 00",
    ):
        assert powered.sdo(request).startswith("60")
    powered.send(frames.nmt(NmtCommand.START, 1))
    sent = [str(f) for f in ticks(powered, 1)]
    assert [text for text in sent if text.startswith("1A1 [4]") and text.endswith("08 00")]
    assert not [text for text in sent if text.startswith("181")]


def test_every_second_sync(powered):
    powered.sdo("2F 00 18 02 02 00 00 00")
    powered.send(frames.nmt(NmtCommand.START, 0))
    assert len([f for f in ticks(powered, 10) if f.can_id == 0x181]) == 5


@pytest.mark.parametrize("command", [None, NmtCommand.STOP, NmtCommand.PRE_OPERATIONAL])
def test_pdos_in_operational_only(powered, command):
    if command is not None:
        powered.send(frames.nmt(NmtCommand.START, 0))
        powered.send(frames.nmt(command, 1))
    assert ticks(powered, 30, Frame(0x201, b"\x01\x00\x00\x00")) == []
    assert powered.world.nodes[0].valve.state is S.INIT


def test_stopped_node_answers_nmt_only(powered):
    powered.send(frames.nmt(NmtCommand.STOP, 1))
    assert powered.sdo("40 00 10 00 00 00 00 00") == ""
    powered.send(frames.nmt(NmtCommand.PRE_OPERATIONAL, 1))
    assert powered.sdo("40 00 10 00 00 00 00 00") != ""


def test_nmt_for_another_node(powered):
    for data in (b"\x01\x02", b"\x01", b"\x01\x01\x01", b"\x33\x01"):
        powered.send(Frame(0x000, data))
    assert powered.world.nodes[0].state is NmtState.PRE_OPERATIONAL


def test_set_point_takes_effect_at_the_next_sync(running):
    valve = running.world.nodes[0].valve
    running.send(Frame(0x201, bytes((7, 0)) + (1000).to_bytes(2, "little")))
    assert valve.demand_pa() == 50e3
    running.send(frames.SYNC)
    assert valve.demand_pa() == 10e3


def test_asynchronous_set_point_takes_effect_at_once(running):
    running.sdo("2F 00 14 02 FE 00 00 00")
    running.send(Frame(0x201, bytes((7, 0)) + (1000).to_bytes(2, "little")))
    assert running.world.nodes[0].valve.demand_pa() == 10e3


def test_event_driven_pdo(powered):
    """TPDO 2 by default: every 100 ms error register, supply 150 kPa, 25 degrees."""
    powered.send(frames.nmt(NmtCommand.START, 0))
    sent = [str(f) for f in ticks(powered, 100) if f.can_id == 0x281]
    assert sent == ["281 [5] 00 DC 05 FA 00"] * 5
    running = powered.world.nodes[0]
    running.dictionary.values[0x1801, 3] = 500  # no more than one in 50 ms
    sent = []
    for temperature in range(251, 271):  # it changes every 5 ms
        running.dictionary.values[0x2100, 2] = temperature
        sent += [f for f in ticks(powered, 1) if f.can_id == 0x281]
    assert [int.from_bytes(frame.data[3:], "little") for frame in sent] == [251, 261]


def test_short_set_point_is_reported_and_ignored(running):
    sent = ticks(running, 1, Frame(0x201, b"\x07\x00\x10"))
    assert emergencies(sent) == ["8210"]
    assert running.world.nodes[0].valve.demand_pa() == 50e3


def test_limits_of_the_device_hold_whatever_is_sent(running):
    ticks(running, 1, Frame(0x201, bytes((7, 0)) + (32767).to_bytes(2, "little")))
    valve = running.world.nodes[0].valve
    assert valve.demand_pa() == 90e3
    status = ticks(running, 1)[0].data[:2]
    assert int.from_bytes(status, "little") & 1 << 10, "limit touched"
