"""A changed configuration is checked like one from a file."""

import re
from pathlib import Path

import pytest

import soro_core
from soro_core.config import with_changes
from soro_core.errors import ConfigError
from soro_core.safety import Limits
from soro_core.twin import TwinConfig
from soro_lab.scene import Scene, load_scene
from soro_lab.scene.options import given_keys


def test_it_keeps_what_was_stated_and_what_was_left_out():
    stated = Limits(maximum_pa=50e3)
    other = with_changes(stated, reading_age_s=0.1)
    assert (other.maximum_pa, other.reading_age_s) == (50e3, 0.1)
    assert other.model_fields_set == {"maximum_pa", "reading_age_s"}
    assert stated.reading_age_s == Limits().reading_age_s


@pytest.mark.parametrize(
    ("start", "values", "key"),
    [
        (Limits(), {"maximum_pa": -1.0}, "maximum_pa"),
        (Limits(), {"maximum_pa": 100e3}, ""),  # not above the pressure that vents
        (Limits(), {"maximum": 1.0}, "maximum"),
        (Scene(), {"valves": "real"}, ""),  # without a platform
        (TwinConfig(), {"air": "states", "pressures": "measured"}, ""),
    ],
)
def test_it_refuses_what_a_file_may_not_say(start, values, key):
    with pytest.raises(ConfigError) as caught:
        with_changes(start, **values)
    assert caught.value.key == key


def test_no_other_copy_skips_the_checks():
    """One exception: the fit of valves, whose free model has no largest pressure."""
    root = Path(soro_core.__file__).parent.parent
    files = [
        file
        for package in ("soro_core", "soro_hardware", "soro_lab", "soro_design", "soro_ros")
        for file in (root / package).rglob("*.py")
    ]
    found = {file.name for file in files if re.search(r"\.model_(copy|construct)\(", file.read_text())}
    assert found == {"valves.py"}


@pytest.mark.parametrize("given", [["platform="], ["platform=null"], ["platform=~"]])
def test_a_scene_without_valves_is_stated_by_a_key_without_a_value(given, tmp_path):
    assert load_scene("track_circle", given_keys(given)).platform == ""
    file = tmp_path / "mine.yaml"
    file.write_text("robot: tue_three_bellow\ndescription:\nplatform:\n")
    assert load_scene(str(file)).platform == ""
