"""What pages show for copying: commands with options that exist, files that load, Python that runs."""

import re
import shlex

import pytest
import typer

from soro_core.config import parse
from soro_core.files.yaml_text import read_value
from soro_hardware.families import parse_platform
from soro_lab.scene import Scene
from soro_ros.cli import application
from tests.docs.test_pages import ROOT, pages

FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"^\s*(soro [a-z].*)$", re.MULTILINE)
SORO = typer.main.get_command(application())


def shown(page):
    return page.read_text(encoding="utf-8")


def commands(text):
    """Yield the command lines of listings, indented or fenced; a line that ends with a backslash goes on."""
    fenced = "\n".join(body for _, body in FENCE.findall(text))
    indented = re.sub(r"^(?! {4}).*$", "", text, flags=re.MULTILINE)
    yield from COMMAND.findall(re.sub(r"\\\n", " ", f"{fenced}\n{indented}"))


def wrong(line):
    """Return what is wrong with a command line; "" for nothing."""
    try:
        _, *words = shlex.split(line, comments=True)
    except ValueError as error:
        return str(error)
    command = SORO
    while hasattr(command, "commands"):
        if not words or words[0] not in command.commands:
            return f"no command {' '.join(words[:1])}"
        command = command.commands[words.pop(0)]
    known = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    options = [found[0] for word in words if (found := re.match(r"--[a-z][\w-]*", word))]
    return ", ".join(option for option in options if option not in {*known, "--help"})


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_have_the_options_that_pages_show(page):
    assert {line: found for line in commands(shown(page)) if (found := wrong(line))} == {}


def test_a_wrong_command_is_found():
    page = (
        "    soro run a --folder b # --c\n\n```\nsoro hil none\n```\n\n    soro plot a \\\n        --ned 3\n"
    )
    assert [wrong(line) for line in commands(page)] == ["no command none", "", "--ned"]


def files():
    """Yield page and content of scenes and platforms that pages show whole."""
    for page in pages():
        for language, body in FENCE.findall(shown(page)):
            data = read_value(body, where=str(page)) if language == "yaml" else None
            # The family `line` is that of docs/adding_a_family.md alone.
            is_platform = isinstance(data, dict) and data.get("family", "line") != "line"
            if is_platform or (isinstance(data, dict) and {"robot", "platform"} <= data.keys()):
                yield pytest.param(data, id=str(page.relative_to(ROOT)))


@pytest.mark.parametrize("data", list(files()))
def test_files_of_pages_load(data):
    if "family" in data:
        parse_platform(data, where="the page")
    else:
        parse(data, Scene, where="the page")


def test_the_python_of_the_readme_runs(monkeypatch):
    monkeypatch.chdir(ROOT)
    (code,) = [body for language, body in FENCE.findall(shown(ROOT / "README.md")) if language == "python"]
    scope = {}
    exec(code, scope)
    assert scope["result"].status.ok
    assert scope["result"].t[-1] == pytest.approx(1.0)
