"""Devices by configuration: mappings over EDS files, nodes of several channels, devices without states."""

import re

import numpy as np
import pytest
from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.eds import import_eds
from hardware_bench import Bench, codes, driver, emulator, platform, platform_file, transcript

from soro_core.config import config_folder
from soro_core.errors import ConfigError, HardwareError
from soro_hardware.canopen import frames
from soro_hardware.canopen.cia408 import ValveState
from soro_hardware.canopen.device import describe
from soro_hardware.canopen.eds import read_eds
from tests.refused import fails

FOUR = [{"chamber": f"link0/chamber{n}", "node": 1, "channel": n} for n in range(4)]
FIVE = [*FOUR[::-1], {"chamber": "link1/chamber0", "node": 2, "channel": 3}]
SCALING = {
    "kind": "fixed",
    "setpoint": {"pa_per_count": 20.0, "zero_count": 100},
    "reading": {"pa_per_count": 25.0, "zero_count": -50},
}
QUIET = {"regulator": {"reading_noise_pa": 0.0}}


def four(**changes):
    return platform(**{"valves": FOUR, "canopen": {"mapping": {"device": "cia408_4ch"}}, **changes})


def moog(**mapping):
    return platform(
        valves=[{"chamber": "link0/chamber0", "node": 5}],
        canopen={"mapping": {"device": "moog_pq", **mapping}, "full_scale_pa": 100e3},
        emulation={"pressure_unit": "normalised"},
    )


def analog(**mapping):
    mapping = {"device": "aventics_aes", "scaling": SCALING, **mapping}
    return platform(valves=FOUR, canopen={"mapping": mapping})


ARMS = {"four channels": four, "two such nodes": lambda: four(valves=FIVE), "p/Q": moog, "analog": analog}


@pytest.fixture(params=ARMS.values(), ids=ARMS.keys())
def arm(request):
    bench = Bench(request.param())
    bench.driver.configure()
    return bench


@pytest.fixture
def quad():
    bench = Bench(four(**QUIET))
    bench.driver.configure()
    return bench


def test_pressures_follow_vent_and_close(arm):
    n = arm.driver.n_chambers
    wanted = np.linspace(20e3, 60e3, n)
    result = arm.run(100, *wanted)
    assert result.faults == ()
    assert result.fresh.all()
    np.testing.assert_allclose(result.sent_pa, wanted, atol=10.0)
    np.testing.assert_allclose(result.pressure_pa, arm.world.pressure_pa, atol=600.0)
    np.testing.assert_allclose(arm.world.pressure_pa, wanted, atol=600.0)
    for _ in range(60):
        arm.driver.vent()
    assert arm.world.pressure_pa.max() < 5e3
    assert arm.run(100, *wanted).faults == ()
    arm.driver.close()
    assert arm.world.pressure_pa.max() < 2.5e3


def test_reset_after_a_reboot(arm):
    arm.run(100, 50e3)
    arm.world.nodes[0].reset(arm.world.now_ns)
    result = arm.run(60, 50e3)
    assert "rebooted" in {code for code, _ in codes(result)}
    assert not result.sent_pa.any()
    arm.driver.configure()
    assert arm.run(100, 50e3).faults == ()
    np.testing.assert_allclose(arm.world.pressure_pa, 50e3, atol=600.0)


def test_start_up_of_four_channels(quad):
    assert quad.bus.take_log() == transcript("start_up_4_channels")


def test_cycle_of_four_channels(quad):
    quad.bus.take_log()
    quad.run(2, 10e3, 20e3, 30e3, 40e3)
    assert quad.bus.take_log() == transcript("cycle_4_channels")


def test_seven_frames_a_cycle_for_twelve_chambers():
    valves = [
        {"chamber": f"link{n}/chamber{c}", "node": n + 1, "channel": c} for n in range(3) for c in range(4)
    ]
    bench = Bench(four(valves=valves))
    bench.driver.configure()
    bench.run(22, 50e3)
    bench.bus.take_log()
    bench.run(1, 50e3)
    assert [line[:5] for line in bench.bus.take_log()] == [
        *("> 201", "> 202", "> 203", "> 080"),
        *("< 181", "< 182", "< 183"),
    ]


def test_control_words_go_out_when_they_change_and_with_the_heartbeat(quad):
    quad.run(1, 20e3)
    quad.bus.take_log()
    quad.run(40, 20e3)
    assert sum(line.startswith("> 301") for line in quad.bus.take_log()) == 8


def test_lost_control_word_is_sent_again(quad):
    send = quad.bus.send
    lost = []

    def lossy(message, timeout=None):
        if message.arbitration_id == 0x301 and not lost:
            lost.append(message)
        else:
            send(message)

    quad.bus.send = lossy
    assert quad.run(100, 30e3).faults == ()
    assert lost
    np.testing.assert_allclose(quad.world.pressure_pa, 30e3, atol=600.0)


def test_one_channel_in_fault_vents_all_and_is_named(quad):
    quad.run(100, 50e3)
    quad.world.nodes[0].valves[2].state = ValveState.FAULT_DISABLED
    result = quad.run(2, 50e3)
    assert ("not_active", "link0/chamber2 (node 1 channel 2)") in codes(result)
    assert not quad.run(1, 50e3).sent_pa.any()
    quad.driver.configure()
    assert quad.run(100, 50e3).faults == ()


def test_emergency_of_a_node_names_all_its_chambers(quad):
    quad.run(10, 50e3)
    quad.world.nodes[0].fault(0x2320, 1, ValveState.FAULT_DISABLED)
    found = codes(quad.run(2, 50e3))
    chambers = ", ".join(f"link0/chamber{n}" for n in range(4))
    assert ("emergency", f"{chambers} (node 1)") in found
    assert {node.state for node in quad.world.nodes[0].valves} <= {
        ValveState.FAULT_REACTION,
        ValveState.FAULT_DISABLED,
    }


def test_silent_state_is_a_fault(quad):
    """Readings arrive, status words do not: whether the valves still follow is unknown."""
    quad.run(20, 50e3)
    quad.driver.vent()
    quad.bus.swallow = {0x281}
    found = codes(quad.run(80, 50e3))
    assert ("not_active", "link0/chamber0 (node 1 channel 0)") in found


def test_vent_and_go_on_at_once(quad):
    """A status word of before the vent must not look like a fall out of ACTIVE."""
    quad.run(20, 50e3)
    for _ in range(10):
        quad.driver.vent()
        assert quad.run(3, 50e3).faults == ()


def test_unused_channels_stay_without_pressure():
    bench = Bench(four(valves=FOUR[1:2]))
    bench.driver.configure()
    bench.run(100, 50e3)
    states = [valve.state for valve in bench.world.nodes[0].valves]
    assert states == [ValveState.INIT, ValveState.ACTIVE, ValveState.INIT, ValveState.INIT]
    assert bench.world.nodes[0].dictionary.values[0x6380, 1] == 0


def test_an_output_vents_at_its_zero_count():
    """0 Pa of an analog output need not be 0 counts."""
    bench = Bench(analog())
    bench.driver.configure()
    bench.run(20, 50e3)
    bench.driver.vent()
    values = bench.world.nodes[0].dictionary.values
    assert [values[0x2401 + n, 0] for n in range(4)] == [100] * 4
    assert [bench.world.nodes[0].valves[n].demand_pa() for n in range(4)] == [0.0] * 4


@pytest.mark.parametrize(
    ("name", "watched"), [("cia408", True), ("cia408_4ch", True), ("moog_pq", True), ("aventics_aes", False)]
)
def test_watchdog_is_what_the_eds_has(name, watched):
    mapping = {"device": name, **({} if watched else {"scaling": SCALING})}
    assert describe(platform(canopen={"mapping": mapping}).canopen.mapping).has_watchdog is watched


def test_fixed_map_is_compared_only():
    fixed = {"number": 4, "entries": ["control", {"index": 0x6300, "sub": 1, "value": 16384}, "setpoint"]}
    bench = Bench(moog(rpdos=[{**fixed, "fixed": True}]))
    bench.driver.configure()
    accesses = {line.split()[3] for line in bench.bus.take_log() if " 03 16 " in line and line[0] == ">"}
    assert accesses == {"40"}, "read, not written"
    assert bench.run(10, 20e3).faults == ()
    bench = Bench(moog(rpdos=[{**fixed, "fixed": True, "entries": ["control", "setpoint"]}]))
    with fails(HardwareError, "1603:0 = 0x3", step="mapping 1603", code="refused"):
        bench.driver.configure()


@pytest.mark.process
def test_same_bytes_over_a_pseudo_terminal(tmp_path):
    changes = {"valves": FOUR, "canopen": {"mapping": {"device": "cia408_4ch"}}}
    path = platform_file(tmp_path, **changes)
    bench = Bench(platform(**changes), seed=4)
    bench.driver.configure()
    with (
        emulator(tmp_path, "--lockstep", "--seed", "4", platform=path) as served,
        driver(platform(**changes), served.device) as regulator,
    ):
        for cycle in range(50):
            ours = bench.exchange(10e3, 20e3, 30e3, 40e3)
            theirs = regulator.exchange(np.array([10e3, 20e3, 30e3, 40e3]), cycle * 5_000_000)
            np.testing.assert_array_equal(ours.pressure_pa, theirs.pressure_pa)
            assert theirs.faults == ()


BAD = {
    "unknown device": ({"device": "festo"}, ("", "aventics_aes", "cia408")),
    "counts not known": ({"device": "aventics_aes"}, ("canopen.mapping.scaling", "'nothing'")),
    "objects not known": ({"device": "camozzi_pme"}, ("canopen.mapping.eds", "'nothing'")),
    "unknown key": ({"rpdo": []}, ("canopen.mapping.rpdo", "'an unknown key'")),
    "status alone": ({"control": None}, ("canopen.mapping", "control and status:")),
    "entry": (
        {"rpdos": [{"number": 1, "entries": ["control", "flow"]}]},
        ("canopen.mapping.rpdos[0]", "entries:", "flow"),
    ),
    "entry twice": (
        {"rpdos": [{"number": 1, "entries": ["setpoint", "setpoint"]}]},
        ("canopen.mapping", "PDO", "once"),
    ),
    "entry missing": ({"tpdos": [{"number": 1, "entries": ["status"]}]}, ("canopen.mapping", "PDO", "once")),
    "PDO number": (
        {"tpdos": [{"number": 5, "entries": ["status"]}]},
        ("canopen.mapping.tpdos[0].number", "4"),
    ),
    "set point by event": (
        {"rpdos": [{"number": 1, "entries": ["control", "setpoint"], "transmission": "event"}]},
        ("canopen.mapping", "SYNC"),
    ),
    "constant in a TPDO": (
        {
            "supply": None,
            "tpdos": [{"number": 1, "entries": ["status", "reading", {"index": 0x6041, "value": 1}]}],
        },
        ("canopen.mapping", "tpdos:", "without"),
    ),
    "object without a value in an RPDO": (
        {"rpdos": [{"number": 1, "entries": ["control", "setpoint", {"index": 0x6042}]}]},
        ("canopen.mapping", "rpdos:", "objects with"),
    ),
    "supply in no PDO": (
        {"tpdos": [{"number": 1, "entries": ["status", "reading"]}]},
        ("canopen.mapping", "reading.0", "status.0", "supply.0", "PDO"),
    ),
}


@pytest.mark.parametrize(("mapping", "found"), BAD.values(), ids=BAD.keys())
def test_bad_mapping(mapping, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        platform(canopen={"mapping": mapping})


AGAINST_EDS = {
    "no EDS": ({"eds": "none.eds"}, ("eds", "'none.eds'", "EDS")),
    "object": ({"setpoint": {"index": 0x6390, "sub": 1}}, ("setpoint", "'6390:1'")),
    "read-only": ({"setpoint": {"index": 0x6381, "sub": 1}}, ("setpoint", "'6381:1'")),
    "limit": ({"upper_limit": {"index": 0x63A5, "sub": 1}}, ("upper_limit", "'63A5:1'")),
    "supply": ({"supply": {"index": 0x2101, "pa_per_count": 100.0}}, ("supply", "'2101:0'")),
    "setting": ({"settings": [{"index": 0x6099, "value": 1}]}, ("settings", "'6099:0'")),
    "not mappable": ({"setpoint": {"index": 0x6394, "sub": 1}}, ("rpdos[number 1]", "'6394:1'")),
    "no such PDO": (
        {"rpdos": [{"number": 3, "entries": ["control", "setpoint"]}]},
        ("rpdos[number 3]", "'PDO 3'"),
    ),
    "too long": (
        {"rpdos": [{"number": 1, "entries": ["control", *[{"index": 0x6040, "value": 0}] * 4, "setpoint"]}]},
        ("rpdos[number 1]", "'12 bytes'", "8", "PDO"),
    ),
}


@pytest.mark.parametrize(("mapping", "found"), AGAINST_EDS.values(), ids=AGAINST_EDS.keys())
def test_mapping_is_checked_against_the_eds(mapping, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        describe(platform(canopen={"mapping": mapping}).canopen.mapping)


def test_a_file_that_is_no_eds(tmp_path):
    path = tmp_path / "bad.eds"
    path.write_text("no sections here\n")
    with fails(ConfigError, "EDS", where=str(path), key=""):
        describe(platform(canopen={"mapping": {"eds": str(path)}}).canopen.mapping)


def edited_eds(tmp_path, **values):
    """The shipped EDS with other values of some keys; None leaves a key out."""
    text = (config_folder() / "canopen" / "cia408.eds").read_text()
    for key, value in values.items():
        text, count = re.subn(rf"^{key}=.*$", "" if value is None else f"{key}={value}", text, flags=re.M)
        assert count
    path = tmp_path / "edited.eds"
    path.write_text(text)
    return path


EMPTY = ["VendorNumber", "ProductNumber", "RevisionNumber", "BaudRate_10", "Granularity", "NrOfRXPDO"]


@pytest.mark.parametrize("keys", [*([key] for key in EMPTY), EMPTY], ids=[*EMPTY, "all of them"])
def test_an_eds_with_empty_values_is_read(tmp_path, keys):
    """As the EDS editor of CANopenNode writes the vendor and product of a new device."""
    path = edited_eds(tmp_path, **dict.fromkeys(keys, ""))
    assert read_eds(path, 1) == read_eds(config_folder() / "canopen" / "cia408.eds", 1)


WRONG = {
    "product": ({"ProductNumber": "four"}, ("[DeviceInfo] ProductNumber", "'four'")),
    "bit rate": ({"BaudRate_250": "yes"}, ("[DeviceInfo] BaudRate_250", "'yes'")),
    "data type": ({"DataType": "u8"}, ("[1000] DataType", "'u8'")),
    "empty data type": ({"DataType": ""}, ("[1000] DataType", "nothing")),
    "no data type": ({"DataType": None}, ("[1000] DataType", "nothing")),
    "no access": ({"AccessType": "all"}, ("[1000] AccessType", "'all'", "rww")),
    "default": ({"DefaultValue": "high"}, ("[1000] DefaultValue", "'high'")),
    "part of a number": ({"DefaultValue": "2.5"}, ("[1000] DefaultValue", "'2.5'")),
    "default beyond its type": ({"DefaultValue": "0x100000000"}, ("[1000] DefaultValue", "32 bits")),
    "octal or not": ({"DefaultValue": "0100"}, ("[1000] DefaultValue", "'0100'", "leading zeros")),
    "limit": ({"LowLimit": "low"}, ("LowLimit", "'low'")),
    "kind": ({"ObjectType": "7"}, ("[1016] ObjectType", "8 or 9")),
}


@pytest.mark.parametrize(("values", "found"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_value_of_an_eds_is_named_with_file_section_and_key(tmp_path, values, found):
    path = edited_eds(tmp_path, **values)
    with pytest.raises(ConfigError) as caught:
        read_eds(path, 1)
    assert caught.value.where == str(path)
    assert caught.value.key.endswith(found[0])
    assert all(name in str(caught.value) for name in found[1:])


SHIPPED = sorted((config_folder() / "canopen").glob("*.eds"))
WRITINGS = {
    "byte order mark": lambda text: "\N{BYTE ORDER MARK}" + text,
    "ends of Windows": lambda text: text.replace("\n", "\r\n"),
    "sections in capital letters": lambda text: re.sub(r"\[.*\]", lambda m: m[0].upper(), text),
    "sections in small letters": lambda text: re.sub(r"\[.*\]", lambda m: m[0].lower(), text),
    "keys in small letters": lambda text: re.sub(r"(?m)^\w+=", lambda m: m[0].lower(), text),
    "spaces": lambda text: re.sub(r"(?m)^(\w+)=(.*)$", r"  \1 = \2\t", text),
    "comments": lambda text: re.sub(r"(?m)^(\w+=\S+)$", r"; a comment\n\1 ; another", text),
    "comments without a space": lambda text: re.sub(r"(?m)^(\w+=[0-9]\w*)$", r"\1;it", text),
    "0X": lambda text: text.replace("=0x", "=0X"),
    "hexadecimal digits": lambda text: re.sub(r"=0x\w+", lambda m: "=0x" + m[0][3:].swapcase(), text),
    "decimal numbers": lambda text: re.sub(r"=0x(\w+)", lambda m: f"={int(m[1], 16)}", text),
    "leading zeros": lambda text: re.sub(r"(?m)=0x0*([0-7])$", r"=000\1", text),
    "more leading zeros": lambda text: text.replace("=0x", "=0x0000"),
    "floats": lambda text: re.sub(r"(?m)^DefaultValue=([0-9]+)$", r"DefaultValue=\1.0", text),
    "node id behind": lambda text: text.replace("$NODEID+0x80", "0x80 + $NodeId"),
    "node id with spaces": lambda text: text.replace("$NODEID+", "$NODEID + "),
    "no kind": lambda text: text.replace("ObjectType=0x7\n", "").replace("ObjectType=0x8\n", ""),
    "empty kind": lambda text: text.replace("ObjectType=0x7\n", "ObjectType=\n"),
    "no mapping where 0": lambda text: text.replace("PDOMapping=0\n", ""),
    "no default where 0": lambda text: re.sub(r"DefaultValue=(0x)?0+\n", "", text),
    "no parameter names": lambda text: re.sub(r"ParameterName=.*\n", "", text),
    "no vendor": lambda text: re.sub(r"(?s)\[FileInfo\].*(?=\[MandatoryObjects)", "", text),
    "vendor with zeros": lambda text: re.sub(r"VendorNumber=.*", "VendorNumber=0010", text),
    "objects behind their parts": lambda text: "[" + "[".join(sorted(text.split("[")[1:], reverse=True)),
    "bytes of no text": lambda text: text.replace("Description=", "Description=\udcb0"),
}


@pytest.mark.parametrize("name", WRITINGS)
@pytest.mark.parametrize("shipped", SHIPPED, ids=lambda path: path.stem)
def test_each_writing_of_an_eds_gives_the_same_entries(tmp_path, shipped, name):
    path = tmp_path / "other.eds"
    path.write_bytes(WRITINGS[name](shipped.read_text()).encode(errors="surrogateescape"))
    assert read_eds(path, 3) == read_eds(shipped, 3)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("[1018sub1]", "[1018 sub1]"),
        ("[1018sub1]", "[0x1018sub1]"),
        ("[1018sub1]", "[1018sub]"),
        ("[1018sub1]", "[1018sub01G]"),
        ("[1018]", "[1018h]"),
        ("[1018]", "[101]"),
        ("[1018]", "[1019]"),
        ("[1018sub1]", "[1018SUB0]"),
        ("[1018sub1]", "[1018sub0]"),
    ],
)
def test_a_section_that_cannot_be_read_is_refused_by_name(tmp_path, before, after):
    """Today's parsers leave it out: a device would lack an object."""
    path = tmp_path / "other.eds"
    text = (config_folder() / "canopen" / "cia408.eds").read_text()
    assert before in text
    path.write_text(text.replace(before, after))
    with pytest.raises(ConfigError) as caught:
        read_eds(path, 3)
    assert caught.value.where == str(path)
    assert any(name in str(caught.value) for name in (after, after[1:-1], "1018"))


@pytest.mark.parametrize("shipped", SHIPPED, ids=lambda path: path.stem)
def test_a_file_that_is_cut_between_two_sections_is_refused(tmp_path, shipped):
    whole = shipped.read_text()
    objects = whole.index("[1000]")
    for end in (k for k, letter in enumerate(whole) if letter == "[" and k > objects):
        path = tmp_path / f"{end}.eds"
        path.write_text(whole[:end])
        with fails(ConfigError, "is the file cut?", where=str(path)):
            read_eds(path, 3)


@pytest.mark.parametrize("shipped", SHIPPED, ids=lambda path: path.stem)
def test_entries_are_those_of_another_reader(shipped):
    known = {}
    for item in import_eds(str(shipped), 3).values():
        for each in [item] if isinstance(item, ODVariable) else item.values():
            if each.data_type < 8:
                known[each.index, each.subindex] = each.min, each.max, each.default or 0, each.pdo_mappable
    found = read_eds(shipped, 3)
    assert {key: (one.low, one.high, one.default, one.mappable) for key, one in found.items()} == known


def test_a_value_with_a_sign_may_be_its_bits(tmp_path):
    path = edited_eds(tmp_path)
    path.write_text(
        path.read_text() + "[2200]\nDataType=3\nAccessType=RW\nDefaultValue=0xFFFE\nLowLimit=0x8000\n"
    )
    entry = read_eds(path, 3)[0x2200, 0]
    assert (entry.default, entry.low, entry.is_signed, entry.writable) == (-2, -32768, True, True)


def test_a_compact_object_has_all_its_parts(tmp_path):
    path = edited_eds(tmp_path)
    text = "[2200]\nObjectType=8\nDataType=6\nAccessType=ro\nCompactSubObj=3\nDefaultValue=7\n"
    path.write_text(path.read_text() + text + "[2200Name]\nNrOfEntries=1\n1=First\n")
    found = read_eds(path, 3)
    assert [found[0x2200, k].default for k in range(4)] == [3, 7, 7, 7]


def test_own_eds_by_path(tmp_path):
    path = tmp_path / "own.eds"
    path.write_text((config_folder() / "canopen" / "cia408.eds").read_text())
    bench = Bench(platform(canopen={"mapping": {"eds": str(path)}}))
    bench.driver.configure()
    assert bench.run(3, 20e3).faults == ()


VALVES = {
    "channel beyond": ([{**FOUR[0], "channel": 4}], ("", "valves:", "0", "3")),
    "channel twice": ([FOUR[0], {**FOUR[1], "channel": 0}], ("", "valves:", "1.0")),
}


@pytest.mark.parametrize(("valves", "found"), VALVES.values(), ids=VALVES.keys())
def test_bad_channels(valves, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        four(valves=valves)


def test_readings_of_foreign_length_are_counted(quad):
    quad.run(5, 20e3)
    quad.bus.inject(frames.Frame(0x181, b"\x00" * 6))
    assert quad.run(1, 20e3).faults == ()
    assert quad.driver.statistics.frames_garbled == 1
