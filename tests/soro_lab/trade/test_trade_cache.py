"""What is kept is found again where it still holds, and nowhere else."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from small import GRID, Counting, robot

import soro_core
from soro_core.robot import Discretisation
from soro_lab.scene import Requirement, Scene
from soro_lab.trade import Candidate, bare_case, cache, run_study
from soro_lab.trade import cache as keys
from soro_lab.trade import study as study_module
from soro_lab.trade.cache import Cache

FEW = replace(GRID, polynomials=(), nodes=(0,), steps=(8,), most=0)


@pytest.fixture(scope="module", autouse=True)
def one_stepper():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_module, "STEPPERS", {"trapezoidal": None})
        yield


@pytest.fixture(scope="module")
def case():
    return bare_case(robot(), 0.3)


@pytest.fixture(scope="module")
def kept(case, tmp_path_factory):
    """A cache after a study with a requirement of 1 %."""
    folder = tmp_path_factory.mktemp("kept")
    run_study(case, FEW, Requirement(error="1%"), Counting(), Cache(folder), repeats=1)
    return folder


def studied(case, folder, error, fresh=False):
    counting = Counting()
    study = run_study(case, FEW, Requirement(error=error), counting, Cache(folder, fresh=fresh), repeats=1)
    return counting.done, study


def test_fresh_measures_anew_and_keeps_it(case, kept, tmp_path):
    folder = shutil.copytree(kept, tmp_path / "cache")
    before = studied(case, folder, "1%")[1].rows
    done, fresh = studied(case, folder, "1%", fresh=True)
    assert len(done) == len(fresh.rows)
    assert fresh.rows != before  # other times
    again, found = studied(case, folder, "1%")
    assert again == []
    assert found.rows == fresh.rows


def test_a_tighter_requirement_takes_a_reference_that_is_good_enough(case, kept, monkeypatch):
    _, first = studied(case, kept, "1%")
    own = first.reference.own.tip
    monkeypatch.setattr(study_module, "converge", None)  # it is not called
    done, study = studied(case, kept, f"{25 * own:.6f}%")  # asks for an own error of 1.25 times that
    assert done == []
    assert study.reference.candidate == first.reference.candidate
    assert study.reference.asked < first.reference.asked
    assert study.reference.converged


def test_a_tighter_requirement_converges_further_where_it_must(case, kept, tmp_path):
    folder = shutil.copytree(kept, tmp_path / "cache")
    _, first = studied(case, folder, "1%")
    done, study = studied(case, folder, f"{5 * first.reference.own.tip:.6f}%")
    assert done
    assert study.reference.own.tip < first.reference.own.tip
    # The finer one serves the coarse requirement too.
    done, coarse = studied(case, folder, "1%")
    assert done == []
    assert coarse.reference.candidate == study.reference.candidate


def test_another_pace_is_another_time_with_the_same_errors(case):
    candidate = Candidate(Discretisation(), "trapezoidal", 0.01)
    paced = replace(case, tick_s=0.002, paced=True)
    assert keys.case_key(paced) == keys.case_key(case)
    assert keys.cost_key(paced, candidate, 1) != keys.cost_key(case, candidate, 1)
    assert keys.cost_key(replace(paced, tick_s=0.001), candidate, 1) != keys.cost_key(paced, candidate, 1)


@pytest.mark.parametrize(
    "change",
    [{"limits": {"maximum_pa": 5e4}}, {"controller": {"adapt": False}}, {"rate_hz": 100.0}, {"seed": 2}],
)
def test_a_loop_depends_on_all_that_the_scene_says_of_it(change):
    plain, other = Scene(), Scene.model_validate(change)
    assert keys.loop_key(plain) != keys.loop_key(other)
    assert keys.choice_key(plain, {}, "") != keys.choice_key(other, {}, "")


def test_results_depend_on_the_sources_of_the_loop():
    root = Path(soro_core.__file__).parents[1]
    found = {path.relative_to(root).as_posix() for path in cache.source_files(root)}
    core = {"loop.py", "safety/limiter.py", "twin/plant.py", "control/controller.py"}
    parts = {f"soro_core/{name}" for name in core} | {"soro_lab/scene/scene.py", "soro_lab/scene/loop.py"}
    assert parts <= found
    assert not any(name.startswith(("soro_lab/bag/", "soro_hardware/")) for name in found)


def test_every_key_depends_on_the_sources(case, monkeypatch):
    candidate = Candidate(Discretisation(), "trapezoidal", 0.01)

    def every():
        return [
            keys.case_key(case),
            keys.reference_key("a"),
            keys.error_key("a", "b", candidate),
            keys.cost_key(case, candidate, 1),
            keys.loop_key(Scene()),
            keys.choice_key(Scene(), {}, ""),
        ]

    before = every()
    assert before == every()
    monkeypatch.setattr(keys, "sources", lambda: "another text")
    assert not set(before) & set(every())
