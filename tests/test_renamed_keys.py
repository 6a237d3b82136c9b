"""Keys under their former names: files of users are read, and one line names the key of today."""

import logging

import pytest

from soro_core import config
from soro_core.config import parse, with_renamed
from soro_core.control.config import ControllerConfig
from soro_core.control.laws.registry import options_of
from soro_core.errors import ConfigError
from soro_hardware.families import parse_platform

VALVES = {
    "family": "canopen_408",
    "transport": {"kind": "slcan", "bitrate": 1000000},
    "valves": [{"chamber": "link0/chamber0", "node": 1}],
    "range": {"maximum_pa": 90e3},
    "cycle_hz": 200.0,
}


@pytest.fixture(autouse=True)
def _fresh(caplog):
    config._log_renamed.cache_clear()
    caplog.set_level(logging.WARNING)


def test_a_platform_whose_regulators_are_under_emulation(caplog):
    former = {**VALVES, "emulation": {"regulator": {"tau_s": 0.1}, "boot_delay_s": 0.2}}
    for _ in range(2):
        platform = parse_platform(former, "arm.yaml")
    assert (platform.regulator.tau_s, platform.emulation.boot_delay_s) == (0.1, 0.2)
    assert [record.getMessage() for record in caplog.records] == [
        "emulation.regulator is read as regulator, its name of today: rename the key"
    ]


def test_a_wrong_value_there_is_named_by_the_key_of_today():
    with pytest.raises(ConfigError, match=r"arm.yaml: regulator.tau_s: .*-1"):
        parse_platform({**VALVES, "emulation": {"regulator": {"tau_s": -1.0}}}, "arm.yaml")


def test_a_key_under_both_names_is_refused():
    both = {**VALVES, "regulator": {"tau_s": 0.1}, "emulation": {"regulator": {"tau_s": 0.2}}}
    with pytest.raises(ConfigError, match=r"regulator without emulation\.regulator"):
        parse_platform(both, "arm.yaml")


def test_the_law_option_uneven():
    data = {"law": "composite", "law_options": {"uneven": False}}
    given = parse(data, ControllerConfig, "scene.yaml")
    assert not options_of(given.law, given.law_options).nonuniform_strain


def test_what_is_no_mapping_or_no_section_is_left_alone():
    renamed = {"a.b": "c"}
    assert with_renamed([1], renamed) == [1]
    assert with_renamed({"a": 1}, renamed) == {"a": 1}
    assert with_renamed({"a": {"d": 1}}, renamed) == {"a": {"d": 1}}
