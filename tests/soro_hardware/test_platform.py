"""Platform files: the shipped one, and one line for everything that can be wrong."""

import pytest
import yaml
from hardware_bench import BASE, platform, platform_file

from soro_core.config import config_folder
from soro_core.errors import ConfigError, HardwareError
from soro_core.safety import Limits, Monitors
from soro_hardware import load_platform, open_regulator
from soro_hardware.limited_regulator import LimitedRegulator
from soro_hardware.platform import Freshness, watched
from tests.refused import fails, refused

BASE_TEXT = yaml.safe_dump(BASE)
VALVES = BASE["valves"]


def test_shipped_platform():
    platform = load_platform("emulated_canopen")
    assert platform.chamber_names == ("link0/chamber0", "link0/chamber1", "link0/chamber2")
    assert (platform.range.minimum_pa, platform.range.maximum_pa) == (0.0, 90e3)
    assert platform.range.maximum_pa < 100e3, "rating of the valves"
    air = platform.regulator
    assert (air.tau_s, air.delay_s, air.reading_noise_pa, air.hysteresis_pa) == (0.052, 0.005, 100.0, 900.0)
    assert platform.canopen.heartbeat_s == 0.025


@pytest.mark.parametrize("path", sorted(config_folder().glob("platforms/*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_platform_loads(path):
    load_platform(path)


def test_a_stale_reading_is_told_with_its_age_and_what_is_allowed():
    times = Freshness()
    assert times.is_stale(1, 60_000_000)
    assert times.too_old(1, 60_000_000) == (
        "no pressure for 60 ms, 1 cycle (limits of the platform: stale_s, 50 ms, or stale_cycles, 3)"
    )
    assert times.too_old(4, 15_000_000).startswith("no pressure for 15 ms, 4 cycles (")


BAD = {
    "unknown key": ({"flow": 3}, ("flow", "'an unknown key'")),
    "unknown nested key": ({"canopen": {"watchdog_s": 1.0}}, ("canopen.watchdog_s", "'an unknown key'")),
    "unknown key in place of a required one": (
        {"valves": [{"chamber": "link0/chamber0", "node_id": 1}]},
        ("valves[0].node_id", "'an unknown key'"),
    ),
    "unknown family": (
        {"family": "ethercat"},
        ("family", "'ethercat'", "canopen_408", "itv_rs232"),
    ),
    "unknown transport": ({"transport": {"kind": "usb"}}, ("transport.kind", "'usb'")),
    "bit rate 800k": (
        {"transport": {"bitrate": 800_000}},
        ("transport.bitrate", "800000", "10000"),
    ),
    "no valves": ({"valves": []}, ("valves", "[]")),
    "valve without node": ({"valves": [{"chamber": "link0/chamber0"}]}, ("valves[0].node", "'nothing'")),
    "node 0": ({"valves": [{**VALVES[0], "node": 0}]}, ("valves[0].node", "0")),
    "node 128": ({"valves": [{**VALVES[0], "node": 128}]}, ("valves[0].node", "128")),
    "node as text": ({"valves": [{**VALVES[0], "node": "1"}]}, ("valves[0].node", "'1'")),
    "chamber name": (
        {"valves": [{**VALVES[0], "chamber": "bellow 1"}]},
        ("valves[0].chamber", "link0/chamber0"),
    ),
    "chamber twice": (
        {"valves": [VALVES[0], {**VALVES[0], "node": 2}]},
        ("", "valves:", "link0/chamber0"),
    ),
    "node twice": ({"valves": [VALVES[0], {**VALVES[1], "node": 1}]}, ("", "valves:", "node", "1")),
    "node of the host": ({"canopen": {"master_node": 2}}, ("", "canopen.master_node:", "2")),
    "NaN": ({"range": {"maximum_pa": float("nan")}}, ("range.maximum_pa", "nan")),
    "no vent in the range": ({"range": {"minimum_pa": 5e3}}, ("range.minimum_pa", "5000.0")),
    "empty range": ({"range": {"maximum_pa": 0.0}}, ("range.maximum_pa", "0.0")),
    "pressure as text": ({"range": {"maximum_pa": "90 kPa gauge"}}, ("range.maximum_pa", "'90 kPa gauge'")),
    "rate 0": ({"cycle_hz": 0.0}, ("cycle_hz", "0.0")),
    "rate too slow for the deadline": (
        {"cycle_hz": 20.0},
        ("", "canopen.rpdo_deadline_s:", "0.1"),
    ),
    "deadline beyond any watchdog": (
        {"canopen": {"rpdo_deadline_s": 0.6}},
        ("canopen.rpdo_deadline_s", "0.6"),
    ),
    "heartbeat beyond any": (
        {"canopen": {"heartbeat_consumer_s": 2.0}},
        ("canopen.heartbeat_consumer_s", "2.0"),
    ),
    "heartbeat too slow": ({"canopen": {"heartbeat_s": 0.08}}, ("", "canopen.heartbeat_consumer_s:")),
    "air": ({"regulator": {"tau_s": -1.0}}, ("regulator.tau_s", "-1.0")),
    "unit": ({"emulation": {"pressure_unit": "psi"}}, ("emulation.pressure_unit", "'psi'")),
}


@pytest.mark.parametrize(("change", "found"), BAD.values(), ids=BAD.keys())
def test_bad_platform(change, found, tmp_path):
    path = platform_file(tmp_path, **change)
    with fails(ConfigError, *found[1:], where=path, key=found[0]):
        load_platform(path)


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (BASE_TEXT + "cycle_hz: 100.0\n", ("", "twice")),
        ("[1, 2]", ("", "mapping")),
        ("family: [", ("", "YAML")),
        ("", ("", "mapping")),
    ],
)
def test_bad_file(content, found, tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text(content)
    with fails(ConfigError, *found[1:], key=found[0]):
        load_platform(path)


def test_missing_file():
    with fails(ConfigError, "no such file", where="missing.yaml"):
        load_platform("missing.yaml")
    with fails(ConfigError, "emulated_canopen", where="missing"):
        load_platform("missing")


def test_other_rate():
    assert platform().at_rate(500.0).cycle_hz == 500.0
    assert platform().at_rate(500.0).emulation == platform().emulation
    with fails(ConfigError, where="platform at 20.0 Hz"):
        platform().at_rate(20.0)


def test_adapter_that_nobody_named():
    with fails(HardwareError, device="slcan", code="setting"):
        open_regulator(platform()).configure()


def test_adapter_that_is_absent(tmp_path):
    regulator = open_regulator(platform(), str(tmp_path / "adapter"))
    with fails(HardwareError, code="open"):
        regulator.configure()
    regulator.vent()
    regulator.close()


@pytest.mark.parametrize(
    ("name", "age_s", "later_s"), [("emulated_canopen", 0.05, 0.0), ("itv_serial", 0.208, 0.028)]
)
def test_what_a_loop_expects_follows_the_platform(name, age_s, later_s):
    platform = load_platform(name)
    regulator = open_regulator(platform, "/dev/null")
    limits, response = watched(platform, regulator, Limits(), 200.0, name)
    assert limits.reading_age_s == pytest.approx(age_s, abs=1e-3)
    own = platform.regulator
    assert response.delay_s - own.delay_s == pytest.approx(later_s, abs=1e-3)
    assert response.tau_s == own.tau_s
    asked, _ = watched(platform, regulator, Limits(reading_age_s=0.4), 200.0, name)
    assert asked.reading_age_s == 0.4
    _, slow_loop = watched(platform, regulator, Limits(), 20.0, name)
    assert slow_loop == own, "a loop slower than the devices waits for no turn"


def test_no_limits_beyond_the_rating_guard_a_regulator():
    """Whoever asks: a program of somebody's own as well."""
    high = Limits(
        maximum_pa=500e3,
        over_pressure_pa=600e3,
        burst_pressure_pa=700e3,
        monitors=Monitors(short_circuit_pa=800e3),
    )
    with refused("limits.maximum_pa", 500e3):
        LimitedRegulator(load_platform("emulated_canopen"), None, high)
