"""The cache of compiled kernels, and the model without compiling."""

import json
import os
import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from soro_core import SoftArm, _jit, load_robot
from soro_core.model.entries import make_box

PACKAGE = Path(_jit.__file__).parent

RUN = """
import json
import numpy as np
from soro_core import SoftArm, robot_from_dict, simulate

link = {"length": 0.1, "radius": 0.02, "mass": 0.05, "k_e": [300, 100, 20], "k_b": [0.02, 0.01, 0.5],
        "damping": [0.1, 1e-6, 1e-6], "creep": [{"tau": 0.1, "stiffness": [1.0, 1e-3, 1e-3]}],
        "hysteresis": [{"stiffness": [1.0, 1e-3, 1e-3], "range": [0.1, 1.0, 1.0]}],
        "chambers": [{"angle_rad": 1.0, "area_m2": 1e-4, "offset_m": 0.01, "area_slope": -1.0}]}
out = []
for how in ({"method": "exact", "nodes": 4}, {"method": "mde", "steps": 4}):
    arm = SoftArm(robot_from_dict({"links": [link, link], "tip_mass": 0.01}), **how)
    q, qd = np.tile([0.1, 5.0, -4.0], 2), np.tile([0.2, 10.0, 20.0], 2)
    out += [*arm.coriolis_matrix(q, qd).ravel(), *arm.mass_regressor(q, qd, qd, qd).ravel()]
    out += [*arm.energy(q, qd), *arm.elastic_regressor(q).ravel(), *arm.jacobian(q, 0.15).ravel()]
    for name in ("trapezoidal", "rk4"):
        run = simulate(arm, q, qd, t_end=2e-3, dt=1e-3, integrator=name, pressure=[1e4, 2e4])
        assert run.status.ok, run.status
        out += [*run.q[-1], *run.qd[-1], *run.internal[-1]]
strains = {"elongation": {}, "bending_x": {"basis": "legendre", "order": 1}, "bending_y": {}}
varying = {**link, "strains": strains, "damping": [0.1, 1e-6, 1e-6, 1e-6], "creep": [], "hysteresis": []}
arm = SoftArm(robot_from_dict({"links": [link, varying, link]}), nodes=3)
q, qd = np.linspace(0.05, 0.1, 10), np.linspace(-0.2, 0.3, 10)
for part in arm.derivatives(q, qd, np.full(arm.n_u, 1e3)):
    out += part.ravel().tolist()
print(json.dumps(out))
"""


def values(**environment):
    done = subprocess.run(
        [sys.executable, "-c", RUN],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, **environment},
    )
    return json.loads(done.stdout)


@pytest.mark.process
def test_same_results_without_compiling():
    """Plain Python also checks every index, which compiled code does not."""
    compiled, plain = values(), values(NUMBA_DISABLE_JIT="1")
    largest = max(abs(v) for v in compiled)
    assert len(compiled) > 100
    assert all(
        abs(a - b) <= 1e-11 * max(abs(a), 1e-6 * largest) for a, b in zip(compiled, plain, strict=True)
    )


def test_cache_folder_is_named_by_the_sources(tmp_path, monkeypatch):
    """A copy of the packages with one changed callee has another folder."""
    assert Path(_jit.numba_config.CACHE_DIR).name == f"kernels-{_jit.source_hash()}"
    callees = ("soro_core/model/links/lie.py", "soro_design/fem/elements/response.py")
    for name in ("soro_core/_jit.py", *callees):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes((PACKAGE.parent / name).read_bytes())
    monkeypatch.setattr(_jit, "__file__", str(tmp_path / "soro_core/_jit.py"))
    seen = [_jit.source_hash()]
    assert _jit.source_hash() == seen[0]
    for name in callees:
        with (tmp_path / name).open("a") as file:
            file.write("# changed\n")
        seen.append(_jit.source_hash())
    assert len(set(seen)) == 3


def test_every_package_with_kernels_is_in_the_hash():
    root = PACKAGE.parent
    imports = re.compile(r"^from soro_core\._jit import .*\b(kernel|inner|entry)\b", re.MULTILINE)
    files = [path for path in root.glob("soro_*/**/*.py") if imports.search(path.read_text(encoding="utf-8"))]
    assert {path.relative_to(root).parts[0] for path in files} == set(_jit.PACKAGES)


CALLEE = "def callee(x):\n    return {}\n"
CALLER = """
from soro_core._jit import inner, kernel
from soro_design.callee import callee as plain
callee = inner(plain)

@kernel
def caller(x):
    return callee(x)
"""


@pytest.mark.process
def test_a_changed_callee_of_another_package_changes_the_result(tmp_path):
    """A process that starts after the change does not get the machine code of before."""
    for package in _jit.PACKAGES:
        shutil.copytree(
            PACKAGE.parent / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    design = tmp_path / "soro_design"
    (design / "caller.py").write_text(CALLER)
    code = "from soro_design.caller import caller; print(caller(1.0))"
    said = []
    for body in ("x + 1.0", "x + 2.0"):
        (design / "callee.py").write_text(CALLEE.format(body))
        # Byte code is told by second and size of its source, and both bodies may be of one second.
        environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
        environment["XDG_CACHE_HOME"] = str(tmp_path / "cache")
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        said.append(float(done.stdout))
    assert said == [2.0, 3.0]


COMPILE = """
import multiprocessing
import numpy as np
from soro_core.model import entries

def several():
    entries.finite(np.zeros(2))

if __name__ == "__main__":
    child = multiprocessing.get_context("spawn").Process(target=several)
    if FIRST:
        child.start()
        child.join()
    several()
    entries.finite(np.zeros(2, np.float32))
"""


@pytest.mark.process
def test_compiling_is_told_once_and_finding_in_the_cache_is_not(tmp_path):
    def said(child: bool, cache: Path) -> list[str]:
        script = tmp_path / "script.py"
        script.write_text(COMPILE.replace("FIRST", str(child)))
        environment = {**os.environ, "XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(PACKAGE.parent)}
        done = subprocess.run(
            [sys.executable, str(script)], capture_output=True, text=True, check=True, env=environment
        )
        return done.stderr.strip().splitlines()

    line = f"soro: compiling the model's kernels, once (some minutes of processor time, cached in {tmp_path}"
    (told,) = said(False, tmp_path)
    assert told.startswith(line)
    assert said(False, tmp_path) == []
    # What a child has compiled, which leaves the word to its parent, is not compiled again.
    (told,) = said(True, tmp_path / "other")
    assert told.startswith(line)


@pytest.mark.process
def test_compiling_says_how_far_it_is(tmp_path):
    """Here after each function, else every 10 s; not of what is in the cache."""
    script = tmp_path / "script.py"
    quick = "from soro_core import _jit\n_jit.PROGRESS_S = 0.0\n"
    script.write_text(quick + COMPILE.replace("FIRST", "False"))
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(PACKAGE.parent)}
    run = partial(subprocess.run, [sys.executable, str(script)], capture_output=True, text=True, check=True)
    first, *others = run(env=environment).stderr.strip().splitlines()
    assert first.startswith("soro: compiling the model's kernels, once")
    told = [re.fullmatch(r"soro: compiling: (\d+) functions done, of at most (\d+)", line) for line in others]
    assert told
    assert all(1 <= int(one[1]) <= int(one[2]) for one in told)
    assert run(env=environment).stderr == ""


PARTS = """
from soro_core._jit import inner

@inner
def twice(x):
    return 2.0 * x

@inner
def sum_of_twice(x):
    total = 0.0
    for i in range(x.shape[0]):
        total += twice(x[i])
    return total
"""
CALLS = """
from numba.core import event
from soro_core._jit import kernel
from parts import sum_of_twice
import json, parts, numpy as np

compiled = []

class Seen(event.Listener):
    def on_start(self, one):
        compiled.append(one.data["dispatcher"].py_func.__name__)

    def on_end(self, one):
        pass

event.register("numba:compile", Seen())

@kernel
def NAME(x):
    return sum_of_twice(x) + 1.0

value = NAME(np.array([1.0, 2.5]))
made = [one for f in (parts.sum_of_twice, NAME) for one in f.overloads.values()]
code = [bool(one.library.get_pointer_to_function(one.fndesc.llvm_func_name)) for one in made]
print(json.dumps([value, compiled, code]))
"""


@pytest.mark.process
def test_what_only_kernels_call_is_linked_and_found_again(tmp_path):
    """It has no machine code of its own, and a kernel of another process takes it from the cache."""
    (tmp_path / "parts.py").write_text(PARTS)

    def run(name):
        script = tmp_path / f"{name}.py"
        script.write_text(CALLS.replace("NAME", name))
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
        environment["PYTHONPATH"] = os.pathsep.join([str(PACKAGE.parent), str(tmp_path)])
        done = subprocess.run(
            [sys.executable, script], capture_output=True, text=True, check=True, env=environment
        )
        return json.loads(done.stdout)

    assert run("first") == [8.0, ["first", "sum_of_twice", "twice"], [False, True]]
    # What it calls in turn lies within it.
    assert run("second") == [8.0, ["second"], [False, True]]
    assert run("second") == [8.0, [], [True]]


def test_a_box_keeps_its_tables_as_long_as_it_lives():
    tables = SoftArm(load_robot("tue_three_bellow")).tables
    counts = [sys.getrefcount(tables.mass)]
    boxes = [make_box(tables) for _ in range(3)]
    counts.append(sys.getrefcount(tables.mass))
    boxes.clear()
    counts.append(sys.getrefcount(tables.mass))
    assert np.diff(counts).tolist() == [3, -3]
