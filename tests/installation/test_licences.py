"""No dependency of soro, nor of one of its extras, is under the GPL or the AGPL."""

import importlib.metadata
import re
import tomllib
from email.message import Message
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
GROUPS = {"": PROJECT["dependencies"], **PROJECT["optional-dependencies"]}

# The LGPL is allowed: python-can, netgen, filib inside ipctk.
FORBIDDEN = re.compile(r"(?<!L)GPL|Affero|(?<!Lesser )(?<!Library or Lesser )General Public License")
# What an extra has all the same, and why.
EXCEPTIONS = {
    ("docs", "docutils"): "of its files one is under the GPL, a mode for Emacs",
}
# Free of charge, but not free software: named, so that no other one comes along unseen.
PROPRIETARY = {
    ("pardiso", name)
    for name in ("mkl", "intel-openmp", "intel-cmplr-lib-ur", "intel-cmplr-lib-rt", "tbb", "tcmlib", "umf")
}


def closure(lines):
    """Distributions installed for requirements, by name; names of those that are not installed."""
    found, missing = {}, set()
    waiting = [(Requirement(line), "") for line in lines]
    seen = set()
    while waiting:
        requirement, extra = waiting.pop()
        name = canonicalize_name(requirement.name)
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": extra}):
            continue
        for wanted in ("", *requirement.extras):
            if (name, wanted) in seen:
                continue
            seen.add((name, wanted))
            if name == "soro":
                waiting += [(Requirement(line), "") for line in GROUPS[wanted]]
                continue
            try:
                found[name] = importlib.metadata.distribution(name)
            except importlib.metadata.PackageNotFoundError:
                missing.add(name)
                continue
            waiting += [(Requirement(line), wanted) for line in found[name].requires or ()]
    return found, missing


def declared(metadata):
    """What a distribution says of its licence: the expression, else the classifiers, else the words."""
    if metadata.get("License-Expression"):
        return metadata["License-Expression"]
    classifiers = [one for one in metadata.get_all("Classifier") or () if one.startswith("License ::")]
    # The text of a whole licence counts by its beginning.
    return "; ".join([*classifiers, (metadata.get("License") or "")[:200]]).strip("; ")


def licence(distribution):
    """What it declares; else the beginning of its licence files, or what a package of ROS declares."""
    said = declared(distribution.metadata)
    if said:
        return said
    files = [one for one in distribution.files or () if one.locate().is_file()]
    texts = [one.read_text()[:200] for one in files if re.search(r"licen[cs]e|copying", one.name, re.I)]
    of_ros = [one.read_text() for one in files if one.name == "package.xml"]
    texts += [said for text in of_ros for said in re.findall(r"<license[^>]*>(.*?)</license>", text)]
    # A wheel that only asks for others has nothing to license.
    has_files = any(".dist-info" not in str(one.parent) for one in files)
    return "; ".join(texts) if texts or has_files else "none: no files"


def is_forbidden(text):
    """Whether all that may be chosen of an expression is under the GPL or the AGPL."""
    return all(FORBIDDEN.search(choice) for choice in re.split(r"\bOR\b", text))


@pytest.mark.parametrize("extra", GROUPS)
def test_no_dependency_is_under_the_gpl(extra, figure):
    found, missing = closure(GROUPS[extra])
    own = {canonicalize_name(Requirement(line).name) for line in GROUPS[extra]} - {"soro"}
    if own and own <= missing:
        pytest.skip(f"the extra {extra} is not installed")
    licences = {name: licence(one) for name, one in found.items()}
    figure(f"licences of {extra or 'soro'}: {len(found)} packages, not installed: {len(missing)}")
    allowed = {name for of, name in EXCEPTIONS if of == extra}
    wrong = {name: text for name, text in licences.items() if is_forbidden(text) and name not in allowed}
    assert not wrong
    unknown = [name for name, text in licences.items() if not text]
    assert not unknown
    sold = {name for name, text in licences.items() if re.search("proprietary|Intel", text, re.I)}
    assert sold <= {name for of, name in PROPRIETARY if of == extra}


def test_the_extra_all_brings_neither_exception():
    found, missing = closure(GROUPS["all"])
    names = {*found, *missing}
    assert "numpy" in names or "ipctk" in names
    assert not names & {name for _, name in (*EXCEPTIONS, *PROPRIETARY)}
    assert not names & {"netgen-mesher", "pypardiso"}


@pytest.mark.parametrize(
    ("fields", "forbidden"),
    [
        ({"License-Expression": "MIT"}, False),
        ({"License-Expression": "LGPL-2.1-only"}, False),
        ({"License-Expression": "GPL-3.0-or-later"}, True),
        ({"License-Expression": "AGPL-3.0-only AND MIT"}, True),
        ({"License-Expression": "MIT OR GPL-2.0-only"}, False),
        ({"Classifier": "License :: OSI Approved :: GNU General Public License v3 (GPLv3)"}, True),
        ({"Classifier": "License :: OSI Approved :: GNU Lesser General Public License v3 (LGPLv3)"}, False),
        (
            {"Classifier": "License :: OSI Approved :: GNU Library or Lesser General Public License (LGPL)"},
            False,
        ),
        ({"License": "GNU Affero General Public License"}, True),
        ({"License": "GPLv2+"}, True),
    ],
)
def test_licences_are_told_apart(fields, forbidden):
    metadata = Message()
    for key, value in fields.items():
        metadata[key] = value
    assert is_forbidden(declared(metadata)) == forbidden
