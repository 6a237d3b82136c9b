"""YAML files: numbers are read as they are written or refused; a small file takes little time and memory."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from soro_core.config import config_folder, load, read_yaml
from soro_core.errors import ConfigError
from soro_core.files.yaml_text import _Loader, read_value
from soro_core.robot import load_robot
from soro_lab.identification.recording import Columns
from tests.refused import fails

CASES = Path(__file__).parents[2] / "shared/data/outside_cases/yaml_numbers"

NUMBERS = {
    "0": 0,
    "-0": 0,
    "+12": 12,
    "1100": 1100,
    "0x1F": 31,
    "-0x1f": -31,
    "true": True,
    "False": False,
    "0.5": 0.5,
    "-.5": -0.5,
    "5.": 5.0,
    "1e3": 1000.0,
    "1E-3": 0.001,
    "1.5e3": 1500.0,
    ".5e3": 500.0,
    "+1.5E+3": 1500.0,
    "0110.5": 110.5,
    "-.inf": float("-inf"),
    "null": None,
    "~": None,
    "": None,
}
# Of many of them YAML 1.1 makes other things.
TEXTS = [
    "yes",
    "No",
    "on",
    "OFF",
    "y",
    "2026-01-01",
    "2026-01-01 12:00:00",
    "=",
    "<<",
    "1.2.3",
    "127.0.0.1:80",
]
TEXTS += ["inf", "nan", "Infinity", "e3", "1e", "0x", "_1", "a_1"]
QUOTED = {"'01100'": "01100", '"11:00"': "11:00", "'yes'": "yes", "'0b1'": "0b1", "!!str 007": "007"}
READ = NUMBERS | dict(zip(TEXTS, TEXTS, strict=True)) | QUOTED


@pytest.mark.parametrize("text", READ)
def test_scalars_are_those_of_yaml_1_2(text):
    assert read_value(f"a: {text}\n", "file") == {"a": READ[text]}
    assert type(read_value(f"a: {text}\n", "file")["a"]) is type(READ[text])


ODD = [
    "01100",
    "-07",
    "00",
    "08",
    "+010",
    "11:00",
    "-1:30",
    "190:20:30.15",
    "0:30.5",
    "1_000",
    "1_0.5",
    "0x_F",
]
ODD += ["0b1010", "0o17", "-0o7", "1e1_0", "0_1", "!!int '011'", "!!float 1_0"]


@pytest.mark.parametrize("text", ODD)
@pytest.mark.parametrize(
    "place", ["links: [{{density: {}}}]", "links:\n  - density: {}", "links: [{{density: [{}]}}]"]
)
def test_numbers_that_readers_take_differently_are_refused_with_their_key(text, place):
    written = text.split()[-1].strip("'")
    with pytest.raises(ConfigError) as caught:
        read_value(place.format(text), "file.yaml")
    assert (caught.value.where, caught.value.got) == ("file.yaml", written)
    assert caught.value.key.startswith("links[0].density")
    assert "in quotes" in caught.value.allowed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1\na: 2", "key 'a' occurs twice"),
        ("a: {b: 1, 'b': 2}", "key 'b' occurs twice"),
        ("? [1]\n: 2", "a key that is no name"),
        ("a: !!set {b}", "the tag"),
        ("a: !!timestamp 2026-01-01", "the tag"),
        ("a: !!python/object:os.system x", "the tag"),
        ("a: &a [*a]", "too many levels"),
        ("a: &a {b: *a}", "too many levels"),
        ("a: &a {<<: *a}", "too many levels"),
        ("a: *b", "undefined"),
        ("a: " + 100 * "[" + 100 * "]", "too many levels"),
        (100_000 * "[", "too many levels"),
        (100_000 * "{a: ", "too many levels"),
        (100_000 * "- ", "too many levels"),
        ("a: [" + 400_000 * "1," + "]", "too many values"),
        ("a: 1" + "0" * 5000, "digits"),
        ("a: 1\n---\nb: 2", "expected"),
        ("a: \0", ""),
        ("a: <<\n<<: 5", "<< of no mapping"),
    ],
)
def test_what_is_no_plain_yaml_is_one_line(text, words):
    with pytest.raises(ConfigError) as caught:
        read_value(text, "file")
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_merge_keys_and_aliases_stay():
    text = "b: &b {x: 1, y: [2]}\nc: &c {x: 3, z: 4}\na: {<<: [*c, *b], z: 5}\nd: {y: 6, <<: *b}\ne: *b"
    found = read_value(text, "file")
    assert found["a"] == {"x": 3, "y": [2], "z": 5}
    assert found["d"] == {"x": 1, "y": 6}
    assert found["e"] == found["b"]
    assert found["e"] is not found["b"]


BOMBS = {
    "lists": "a0: &a0 [x,x,x,x,x,x,x,x,x]\n"
    + "".join(f"a{k}: &a{k} [{','.join(9 * [f'*a{k - 1}'])}]\n" for k in range(1, 10)),
    "mappings": "a0: &a0 {p: x, q: x, r: x}\n"
    + "".join(f"a{k}: &a{k} {{p: *a{k - 1}, q: *a{k - 1}, r: *a{k - 1}}}\n" for k in range(1, 25)),
    "merges": "a0: &a0 {p: x}\n"
    + "".join(f"a{k}: &a{k} {{<<: [{','.join(9 * [f'*a{k - 1}'])}]}}\n" for k in range(1, 10)),
}


@pytest.mark.process
@pytest.mark.parametrize("name", BOMBS)
def test_aliases_of_aliases_cost_little(tmp_path, name):
    """In a process of 1 GB of memory and 20 s of processor, with the interpreter and its imports."""
    file = tmp_path / "robot.yaml"
    file.write_text(BOMBS[name])
    assert file.stat().st_size < 1500

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30))
        resource.setrlimit(resource.RLIMIT_CPU, (20, 20))

    program = f"from soro_core.config import read_yaml\nread_yaml({str(file)!r})"
    ended = subprocess.run(
        [sys.executable, "-c", program], preexec_fn=limit, capture_output=True, text=True, timeout=120
    )
    last = ended.stderr.splitlines()[-1]
    assert "too many values" in last or "too many levels" in last, ended.stderr[-500:]


def test_a_file_that_is_too_long_is_not_read(tmp_path):
    file = tmp_path / "long.yaml"
    with file.open("w") as stream:
        stream.truncate(20 * 2**20)
    with fails(ConfigError, "20971520 bytes", where=str(file), key=""):
        read_yaml(file)


def test_a_word_where_true_or_false_is_meant_says_so(tmp_path):
    file = tmp_path / "map.yaml"
    base = "{position: [x, y, z], quaternion: [a, b, c, d], moves: yes}"
    file.write_text(f"pressures: {{columns: {{c: p}}}}\nbase: {base}\n")
    with fails(ConfigError, "'yes'", "true or false", where=str(file), key="base.moves"):
        load(file, Columns)


SHIPPED = sorted(config_folder().rglob("*.yaml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_files_are_read(path):
    assert read_yaml(path)


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared outside cases are not here")
@pytest.mark.parametrize(("name", "got"), [("octal", "01100"), ("sex", "11:00")])
def test_outside_cases(name, got):
    with fails(ConfigError, got, where=str(CASES / f"{name}.yaml"), key="links[0].density"):
        load_robot(CASES / f"{name}.yaml")


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="this PyYAML is without libyaml")
def test_libyaml_reads():
    """Twelve times as fast as the parser in Python."""
    assert issubclass(_Loader, yaml.CSafeLoader)
