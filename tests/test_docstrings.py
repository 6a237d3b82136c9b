"""Public functions of three or more arguments have numpydoc parameters; kernels apart."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
KERNELS = {"inner", "kernel", "entry"}
# Folders whose functions are all documented; a package with a slash at its end: the files beside its folders.
FOLDERS = (
    "soro_core/",
    "soro_lab/analysis",
    "soro_lab/bag",
    "soro_core/control",
    "soro_design/topology",
    "soro_hardware/emulation",
    "soro_core/estimation",
    "soro_lab/excitation",
    "soro_design/fem",
    "soro_hardware",
    "soro_hardware/hil",
    "soro_lab/identification",
    "soro_core/integrate",
    "soro_core/model",
    "soro_core/pneumatics",
    "soro_lab/reporting",
    "soro_core/robot",
    "soro_lab/scaffold",
    "soro_core/safety",
    "soro_lab/scene",
    "soro_lab/trade",
    "soro_core/twin",
    "soro_ros",
)


def files(folder):
    """Source files of a folder; of a package, written with a slash at its end, those beside its folders."""
    path = ROOT / folder
    found = path.glob("*.py") if folder.endswith("/") else path.rglob("*.py")
    return sorted(one for one in found if not one.name.startswith("_"))


def public_functions(folder):
    """Yield place, function and owner of public functions and methods; the owner documents a constructor."""
    for path in files(folder):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in tree.body:
            for function in [node, *(node.body if isinstance(node, ast.ClassDef) else [])]:
                if isinstance(function, ast.FunctionDef) and not node.name.startswith("_"):
                    yield f"{path.relative_to(ROOT)}: {function.name}", function, node


def arguments(function):
    found = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    starred = [one for one in (function.args.vararg, function.args.kwarg) if one is not None]
    return [one.arg for one in [*found, *starred] if one.arg not in ("self", "cls")]


def undocumented(folder):
    """Yield public functions of three or more arguments with the arguments that lack a numpydoc entry."""
    for place, function, owner in public_functions(folder):
        decorators = {ast.unparse(one) for one in function.decorator_list}
        is_private = function.name.startswith("_") and function.name != "__init__"
        # The docstring of a command is its --help.
        is_command = "Annotated[" in ast.unparse(function.args)
        names = arguments(function)
        if is_private or is_command or len(names) < 3 or decorators & KERNELS:
            continue
        text = ast.get_docstring(owner if function.name == "__init__" else function) or ""
        # An implementation may refer to the function that it implements, which is checked by itself.
        if re.search(r"\bparameters as in `[\w.]+`", text):
            continue
        section = text.partition("Parameters\n----------\n")[2].split("\n\n")[0]
        entries = " ".join(line for line in section.splitlines() if re.match(r"[\w*, ]+ : ", line))
        missing = [name for name in names if not re.search(rf"\b{name}\b", entries)]
        if missing:
            yield f"{place}: {', '.join(missing)}"


@pytest.mark.parametrize("folder", FOLDERS)
def test_parameters_are_documented(folder):
    assert list(undocumented(folder)) == []


def test_a_missing_parameter_is_found(tmp_path, monkeypatch):
    source = '''
class Valve:
    """A valve.

    Parameters
    ----------
    a, b : float
        Numbers.
    """

    def __init__(self, a, b, c): ...

    def documented(self, a, b, c):
        """Do it; parameters as in `Valve.other`."""

    def other(self, a, b, *c):
        """Do it.

        Parameters
        ----------
        a, b, *c : float
            Numbers.
        """
'''
    (tmp_path / "valve.py").write_text(source, encoding="utf-8")
    monkeypatch.setattr("tests.test_docstrings.ROOT", tmp_path)
    assert list(undocumented(".")) == ["valve.py: __init__: c"]
