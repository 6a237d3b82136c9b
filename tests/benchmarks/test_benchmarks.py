"""The benchmarks run through with their smallest settings, without the peer; no time is asserted."""

import math
import re
from functools import partial

import numpy as np
import pytest
from result_tables import tables, written
from typer.testing import CliRunner

from benchmarks import mismatched_arms, peer, report, rod, terms
from benchmarks.__main__ import SECTIONS, app
from benchmarks.judged_loop import Outcome
from benchmarks.release import LADDER, LIMIT, Reference, first_good, ours
from benchmarks.timing import Clock, per_call
from soro_core import SoftArm
from soro_ros.recordings.verdict import Verdict
from tests.apparatus.extremes import crushed
from tests.apparatus.extremes.arms import DENSITY, Arm
from tests.apparatus.extremes.measure import Release


@pytest.fixture
def run(tmp_path):
    def call(*arguments):
        result = CliRunner().invoke(app, ["--quick", "--no-peer", "--out", str(tmp_path), *arguments])
        path = tmp_path / "RESULTS.md"
        return result, path.read_text() if path.exists() else ""

    return call


@pytest.mark.slow
@pytest.mark.parametrize("name", ["forward", "derivatives", "terms", "realtime"])
def test_a_section_is_written_with_numbers(run, name):
    result, text = run("--only", name)
    assert result.exit_code == 0, result.output
    assert f"## {SECTIONS[name].TITLE}" in text
    rows = [line for line in text.splitlines() if re.match(r"\| (1|gravity) \|", line)]
    assert rows
    assert not any("nan" in row or "inf" in row for row in rows)
    assert "% of the core while timing" in text
    assert name == "terms" or "soromox was not measured" in text


@pytest.mark.slow
def test_each_ingredient_has_its_row_in_the_results():
    section = (report.Path(report.__file__).parent / "RESULTS.md").read_text().split(f"## {terms.TITLE}\n")[1]
    assert set(terms.INGREDIENTS) <= set(re.findall(r"^\| ([^|]+) \|", section.split("\n## ")[0], re.M))


def test_one_link_of_order_4_beats_eight_of_constant_strain(tmp_path):
    """As docs/trade.md says: tenfold and more under a follower force and along a taper."""
    (rows,) = tables(written(tmp_path, "orders"))
    high, many = rows
    assert (high["links"], many["links"]) == ("1 of order 4", "8 of constant strain")
    for column in ("follower 4 EI/L^2", "follower 12 EI/L^2", "taper"):
        assert float(high[column]) < 0.1 * float(many[column])
    assert float(many["taper"]) < 0.2 * float(many["taper as steps"])


@pytest.mark.slow
def test_the_section_of_design_has_all_its_parts(run):
    result, text = run("--only", "design")
    assert result.exit_code == 0, result.output
    assert text.count("### ") == len(SECTIONS["design"].PARTS)
    assert "| 20 | 17.11 |" in text
    assert "nan" not in text


@pytest.mark.slow
def test_the_sections_of_the_solver(run):
    result, text = run("--only", "solver")
    assert result.exit_code == 0, result.output
    assert "| bellow | 570 |" in text
    assert "| SuperLU |" in text


def test_sections_not_asked_for_stay(run, tmp_path):
    report.write(tmp_path / "RESULTS.md", {"Kept": "| 42 |", SECTIONS["terms"].TITLE: "old"})
    _, text = run("--only", "terms")
    assert "## Kept\n\n| 42 |\n" in text
    assert "old" not in text


def test_an_unknown_section_is_refused_by_name(run):
    result, text = run("--only", "forward,walk")
    assert result.exit_code == 2
    assert "walk: allowed are startup, discovery, forward" in re.sub(r"[│\s]+", " ", result.output)
    assert text == ""


def test_times_are_medians_per_call(monkeypatch):
    clock = iter(np.arange(1000.0))
    monkeypatch.setattr("benchmarks.timing.CLOCK.time", lambda call: (call(), next(clock))[1] * 0.0 + 6e-3)
    counts = []
    times = per_call({"a": counts.append}, repeats=3, sample_s=0.06)
    assert counts == [1, 1, 10, 100, 100, 100]
    assert times["a"] == pytest.approx(6e-3 / 100)


def test_a_sample_leaves_out_what_others_took(monkeypatch):
    wall, cpu = iter([0.0, 3.0]), iter([0.0, 1.0])
    monkeypatch.setattr("benchmarks.timing.time.perf_counter", lambda: next(wall))
    monkeypatch.setattr("benchmarks.timing.time.process_time", lambda: next(cpu))
    clock = Clock()
    assert clock.time(lambda: None) == 1.0
    assert clock.share == pytest.approx(1 / 3)


def test_the_search_finds_the_largest_good_step():
    reference = Reference(1, t_end=0.05)
    arm = SoftArm(rod.robot(1), nodes=4)
    make = partial(ours, arm, "trapezoidal", t_end=0.05)
    found = first_good(reference, make)
    assert 0 < found.error <= LIMIT
    steps = next(n for n in LADDER if make(n).setting == found.candidate.setting)
    assert reference.error(make(steps).run()) == found.error
    assert reference.error(make(LADDER[LADDER.index(steps) - 1]).run()) > LIMIT
    assert reference.error(None) == math.inf
    assert reference.enough(6)
    assert not reference.enough(2)


def test_coordinates_of_the_peer_there_and_back():
    q, _ = rod.states(3, count=4)
    np.testing.assert_array_equal(peer.from_peer(peer.to_peer(q)), q)
    # Elongation, bending_x, bending_y; about its y, about its z, elongation.
    np.testing.assert_array_equal(peer.to_peer(np.array([1.0, 2.0, 3.0])), [-3.0, 2.0, 1.0])


@pytest.mark.skipif(not peer.available(), reason="soromox is not installed")
def test_the_peer_computes_the_same_accelerations():
    from benchmarks.forward import accelerations, distance

    q, qd = rod.states(1, count=8)
    arm = SoftArm(rod.robot(1, rod.ANY), nodes=peer.DEFAULT_GAUSS_POINTS)
    theirs = peer.accelerations(peer.compiled(peer.make(1, rod.ANY)), q, qd)
    assert distance(theirs, accelerations(arm, q, qd)) < 1e-5


def test_error_control_tells_whether_a_link_is_crushed():
    """Let go from four times its length a link swings beyond nothing; a slightly bent one does not."""
    dt = 2e-4
    at, off = crushed.run(Release(Arm(1), elongation=3.0, dt=dt, steps=50), seed=1)
    # Uniform strain: a third of the mass swings on EA / L, and nothing is left at 1 + 3 cos(w t) = 0.
    arm = Arm(1)
    rate = math.sqrt(3.0 * arm.youngs_modulus / DENSITY) / arm.length
    assert at == pytest.approx(math.acos(-1.0 / 3.0) / rate, abs=1.1 * dt)
    assert off < 1e-4
    assert crushed.run(Release(Arm(1), turns=0.05, steps=50), seed=1)[0] is None


def weak(ratio, cause="", notes=()):
    """What a lost run says of a chamber whose true gain is 1.49 of the mean, 1.78 of the middle one."""
    named = f"link0/chamber2 gives {ratio} of the force that its file says"
    return Outcome(0.2, Verdict("lost", f"far; probable cause: {cause or named}; next: look", notes))


@pytest.mark.parametrize(
    ("found", "known", "right", "wrong"),
    [
        (weak(1.6), "", 1, 0),
        (weak(0.6), "", 0, 1),
        (weak(1.6, notes=("controller: probe: tip: poses are stamped 20 ms late",)), "", 1, 1),
        (weak(1.6, "the arm differs from its robot file"), "good", 0, 1),  # a chamber would have to be named
        (weak(1.6, "limits.maximum_pa, 90 kPa, holds set points back"), "poor", 1, 0),
        (weak(1.6, "limits.maximum_pa, 90 kPa, holds set points back"), "good", 0, 1),
        (weak(1.6, "look for an obstacle"), "poor", 0, 1),
        (Outcome(0.01, Verdict("good", "", ("link0/chamber1 gives 1.20 of the force",))), "", 0, 1),
    ],
)
def test_true_causes_of_a_random_arm_are_told_from_wrong_ones(monkeypatch, found, known, right, wrong):
    truth = Outcome(0.0, Verdict(known))
    monkeypatch.setattr(mismatched_arms, "measured", lambda n, known=False: truth if known else found)
    monkeypatch.setattr(mismatched_arms, "is_refused", lambda n: False)
    judged = mismatched_arms.judged(3)
    assert (len(judged.right), len(judged.wrong)) == (right, wrong)
