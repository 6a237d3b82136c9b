"""What a forge reads: jobs, forms for issues, hooks before a commit; each names what exists."""

import re
import shlex
import tomllib

import pytest
import yaml

from tests.docs.test_pages import ROOT
from tests.docs.test_snippets import wrong
from tests.installation.environments import find_pythons

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
FORMS = sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml"))


@pytest.mark.process
def test_jobs_run_every_python_and_targets_of_the_makefile():
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"]
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    matrix = jobs["make"]["strategy"]["matrix"]
    asked = {*matrix["target"], *(one["target"] for one in matrix["include"])}
    assert asked == {"lint", "check", "pytest", "docs"}
    assert asked <= targets
    for job in jobs.values():
        assert job["strategy"]["matrix"]["python"] == list(find_pythons(PROJECT["requires-python"]))


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.stem)
def test_forms_ask_for_platform_file_bag_and_doctor(form):
    content = yaml.safe_load(form.read_text())
    assert {"name", "description", "body"} <= content.keys()
    fields = [one for one in content["body"] if one["type"] != "markdown"]
    assert {one["type"] for one in fields} <= {"textarea", "input", "dropdown"}
    assert (
        len({one["id"] for one in fields})
        == len({one["attributes"]["label"] for one in fields})
        == len(fields)
    )
    asked = " ".join(
        f"{one['attributes']['label']} {one['attributes'].get('description', '')}" for one in fields
    )
    assert all(word in asked for word in ("Platform file", "bag", "soro doctor"))
    lines = re.findall(r"`(soro [^`]+)`", form.read_text())
    assert {line: found for line in lines if line != "soro --version" and (found := wrong(line))} == {}


def test_hooks_run_programs_that_the_lint_has_installed():
    hooks = [
        hook
        for repo in yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
        for hook in repo["hooks"]
    ]
    installed = {re.split(r"[^\w-]", line)[0] for line in PROJECT["optional-dependencies"]["test"]}
    for hook in hooks:
        program = shlex.split(hook["entry"])[0]
        assert program.removeprefix(".venv/bin/") in installed
