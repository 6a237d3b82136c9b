"""The releases of packages and of Python that pyproject.toml states; `make newest` runs soro with them."""

import tomllib

import pytest
from packaging.requirements import Requirement

from tests.installation.environments import find_pythons, lowest, requirements
from tests.installation.source_tree import ROOT

TEXT = (ROOT / "pyproject.toml").read_text()
PROJECT = tomllib.loads(TEXT)["project"]
LIMITED = [
    line
    for line in (f'requires-python = "{PROJECT["requires-python"]}"', *requirements(PROJECT))
    if {"<", "=="} & {word for word in ("<", "==") if word in line.partition(";")[0]}
]


@pytest.mark.parametrize("line", LIMITED)
def test_an_upper_bound_has_a_reason_above_it(line):
    above, _, _ = TEXT.partition(line)
    assert above.splitlines()[-2 if above.splitlines()[-1].strip() == '"' else -1].strip().startswith("# ")


def test_the_lowest_releases_are_those_of_every_requirement_that_states_one():
    stated = [line for line in requirements(PROJECT) if ">=" in line.partition(";")[0]]
    pins = [Requirement(pin) for pin in lowest(stated)]
    assert [pin.name for pin in pins] == [Requirement(line).name for line in stated]
    for pin, line in zip(pins, stated, strict=True):
        (release,) = pin.specifier
        assert release.operator == "=="
        assert Requirement(line).specifier.contains(release.version)


@pytest.mark.process
def test_the_pythons_tried_are_those_allowed():
    assert list(find_pythons(">=3.11,<3.14")) == ["3.11", "3.12", "3.13"]
