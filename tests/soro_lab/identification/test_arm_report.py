"""The report: a page that needs no network, with the numbers of report.json and of the result."""

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from made_result import END_S, HELD_S, made

from soro_lab.identification.arm.cases.physical import Unphysical
from soro_lab.identification.arm.profiles import least_certain, profiles
from soro_lab.identification.arm.report import ReportContent, write_report
from soro_lab.identification.arm.report.content import content_of
from soro_lab.identification.arm.report.repeats import repeats
from soro_lab.identification.arm.report.traces import ShapeTrace, traces
from soro_lab.identification.arm.robot_yaml import number_table
from soro_lab.identification.arm.search.uncertainty import Uncertainty
from soro_lab.identification.arm.stages import ArmIdentification
from soro_lab.identification.recording import Place, Plate, Recording, Series

VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Cells with a place in report.json, addresses, text; elements that are not closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.tags: set[str] = set()
        self.cells: list[tuple[str, float, str]] = []
        self.text = ""
        self.place: tuple[str, float] | None = None
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        own = dict(attrs)
        self.tags.add(tag)
        self.addresses += [own[key] for key in ("src", "href", "data", "action") if key in own]
        if tag not in VOID:
            self.open.append(tag)
        if "data-path" in own:
            self.place = own["data-path"], float(own["data-factor"])

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data
        if self.place is not None:
            self.cells.append((*self.place, data))
            self.place = None


@pytest.fixture(scope="module")
def found() -> ArmIdentification:
    return made()


@pytest.fixture(scope="module")
def folder(found: ArmIdentification, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "new"
    own, _ = profiles(found, ())
    write_report(ReportContent(found, 0.1, own, (), "arm.yaml"), path)
    return path


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return Page((folder / "index.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def content(folder: Path) -> dict:
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_the_page_needs_no_network(page: Page, folder: Path) -> None:
    assert page.addresses
    assert all(address.startswith(("data:image/", "#")) for address in page.addresses)
    assert not page.tags & {"script", "link", "iframe", "object"}
    text = (folder / "index.html").read_text(encoding="utf-8")
    assert "://" not in text
    assert "url(" not in text
    assert len(text) < 1_500_000
    assert sorted(path.name for path in folder.iterdir()) == ["index.html", "pictures", "report.json"]


def test_every_picture_of_the_page_is_a_file(page: Page, folder: Path) -> None:
    files = sorted((folder / "pictures").iterdir())
    assert len(files) == sum(address.startswith("data:image/") for address in page.addresses)
    starts = {".png": b"\x89PNG", ".svg": b"<?xml"}
    assert all(file.read_bytes().startswith(starts[file.suffix]) for file in files)


def test_every_run_has_a_heading_and_a_picture(page: Page, found: ArmIdentification) -> None:
    names = [case.name for case in found.problem.cases]
    assert all(f"{name}, tip" in page.text for name in names)
    assert sum(address.startswith("data:image/png") for address in page.addresses) == len(names)


@pytest.mark.slow
def test_numbers_of_the_page_are_those_of_the_file(page: Page, content: dict) -> None:
    assert len(page.cells) > 100
    for path, factor, text in page.cells:
        value = content
        for key in path.split("."):
            value = value[int(key) if isinstance(value, list) else key]
        assert float(text) == pytest.approx(factor * value, rel=6e-2, abs=1e-12), path


def test_numbers_of_the_file_are_those_of_the_result(content: dict, found: ArmIdentification) -> None:
    assert {n["name"]: n["value"] for n in content["numbers"]} == found.solution.values
    assert {n["name"]: n["deviation"] for n in content["numbers"]} == found.certainty.deviations
    assert content["verdict"]["held_out_share"] == found.held_out_share
    parts = {(e["run"], e["part"]): (e["rms"], e["worst"], e["beyond_three"]) for e in content["errors"]}
    for part, errors in (("fitted", found.fitted), ("held out", found.held_out)):
        assert all(parts[e.case, part] == (e.rms, e.worst, e.written_off) for e in errors)
    np.testing.assert_allclose(content["correlation"]["matrix"], found.certainty.correlation, atol=1e-4)
    assert found.choice is not None
    assert {law["name"]: law["error"] for law in content["laws"]} == {
        trial.name: trial.error for trial in found.choice.tried
    }
    assert [law["name"] for law in content["laws"] if law["chosen"]] == ["linear"]
    assert [each["name"] for each in content["undetermined"]] == ["link0/gain"]
    assert [run["held_out_s"] for run in content["data"]] == [[list(HELD_S)]] * 3
    assert all(run["fitted_s"][-1][-1] <= END_S for run in content["data"])
    values = found.solution.values
    for kind, name in (("worlds", "tracker"), ("bodies", "tip")):
        (entry,) = content["frames"][kind]
        assert entry["name"] == name
        for key, number in (("offset_m", "offset"), ("rotation_vector_rad", "turn")):
            assert entry[key] == [values[f"frame/{name}/{number}_{axis}"] for axis in "xyz"]


def test_a_run_that_the_soft_loss_wrote_off_is_shown(content: dict, page: Page) -> None:
    off = {run["run"]: run["written_off"] for run in content["runs"]}
    assert off == {"run <1>": False, "run <2>": False, "run <3>": True}
    assert "written off" in page.text
    assert any("run <3>" in line for line in content["verdict"]["next"])


def _content(found: ArmIdentification, accept: float = 0.1, odd: tuple[Unphysical, ...] = ()) -> dict:
    return content_of(ReportContent(found, accept, (), odd, "arm.yaml"), traces(found))


def test_without_a_damaged_run_none_is_written_off() -> None:
    content = _content(made(damaged=False))
    assert not any(run["written_off"] for run in content["runs"])
    assert content["verdict"]["accepted"]


def test_what_no_arm_has_is_not_accepted(found: ArmIdentification) -> None:
    odd = (Unphysical("link0/k_b", -1.0, "N m/rad", "above 0", ("link0/k_b",)),)
    assert _content(found, 10.0)["verdict"]["accepted"]
    content = _content(found, 10.0, odd)
    assert not content["verdict"]["accepted"]
    assert [n["marks"] for n in content["numbers"] if n["name"] == "link0/k_b"] == [["unphysical"]]


def test_without_held_out_sections_nothing_is_accepted(found: ArmIdentification) -> None:
    none = replace(found, held_out=(), held_out_share=float("nan"), choice=None, held_cases=())
    verdict = _content(none, 10.0)["verdict"]
    assert (verdict["accepted"], verdict["held_out_share"]) == (False, None)


def test_a_number_at_its_bound_has_no_deviation(found: ArmIdentification) -> None:
    sure = found.certainty
    bound = Uncertainty(sure.deviations, sure.correlation, sure.undetermined, ("link0/k_b",))
    at_bound = replace(found, certainty=bound)
    own = next(n for n in _content(at_bound)["numbers"] if n["name"] == "link0/k_b")
    assert (own["deviation"], own["marks"]) == (None, ["at its bound"])
    row = next(line for line in number_table(at_bound) if line.startswith("link0/k_b"))
    assert row.split()[2] == "-"
    assert "at its bound" in row
    assert "link0/k_b" not in least_certain(at_bound)


def test_a_prediction_without_difference_is_what_was_measured(found: ArmIdentification) -> None:
    one = traces(found)[0]
    np.testing.assert_array_equal(one.held_out, (one.stream.t >= HELD_S[0]) & (one.stream.t <= HELD_S[1]))
    place, turn = one.panels
    np.testing.assert_allclose(place.measured - place.predicted, 1e3 * one.differences[:, :3], atol=1e-9)
    # Of small differences the angle between both is the length of the difference of their vectors.
    apart = np.linalg.norm(turn.measured - turn.predicted, axis=1)
    left = np.degrees(np.linalg.norm(one.differences[:, 3:], axis=1))
    np.testing.assert_allclose(apart[:20], left[:20], rtol=0.1, atol=0.02)


def test_simulated_profiles_are_near_the_linear_ones(found: ArmIdentification) -> None:
    names = least_certain(found, 1)
    done: list[float] = []
    own, interrupted = profiles(found, names, lambda stage, share: done.append(share))
    assert (interrupted, done) == (False, [1.0])
    assert [each.name for each in own if each.is_searched] == list(names)
    lines, _ = profiles(found, ())
    for each, line in zip(own, lines, strict=True):
        if each.is_searched:
            rises = [p.rise for p in each.points], [p.rise for p in line.points]
            np.testing.assert_allclose(*rises, rtol=0.5, atol=0.3)


def _repeated(spread: float, late_s: float = 0.0) -> ShapeTrace:
    """One sequence of pressures twice; the shape of the second time is noisy, or late."""
    t = np.arange(0.0, 24.0, 0.05)
    once = np.sin(2 * np.pi * t / 12.0) + 0.5 * np.sin(2 * np.pi * t / 5.0) * (t < 12.0)
    wave = np.where(t < 12.0, once, np.interp(t - 12.0, t, once))
    shown = np.where(t < 12.0, wave, np.interp(t - late_s, t, wave))
    draw = np.random.default_rng(1)
    position = np.column_stack([shown, np.zeros_like(t), np.zeros_like(t)]) * 1e-2
    position += draw.normal(0.0, spread, position.shape)
    plate = Plate("tip", t, Place(0), position, np.tile([0, 0, 0, 1.0], (len(t), 1)))
    recording = Recording("one", ("c",), Series("pressure", t, 1e4 * wave[:, None]), plates=(plate,))
    missed = np.column_stack([np.full(len(t), 2e-3), np.zeros((len(t), 5))])
    none = np.zeros(len(t), bool)
    return ShapeTrace("one", "tip", recording, plate, missed, np.ones(6), np.ones(len(t)), none, (), ())


def test_repeats_show_the_floor_of_the_error() -> None:
    (own,) = repeats([_repeated(1e-4)])
    assert own.pairs > 0.5 * own.samples
    assert own.spread == pytest.approx(np.sqrt(3) * 1e-4, rel=0.15)
    assert own.error == pytest.approx(2e-3)
    (late,) = repeats([_repeated(1e-4, 0.3)])
    assert late.spread > 4 * own.spread


def test_a_sequence_that_never_returns_has_no_repeats() -> None:
    one = _repeated(1e-4)
    p = np.linspace(0.0, 1e4, len(one.stream.t))[:, None]
    rising = replace(one.recording, pressure=Series("pressure", one.stream.t, p))
    assert repeats([replace(one, recording=rising)]) == ()
    # A long rest at one level is one visit.
    still = replace(one.recording, pressure=Series("pressure", one.stream.t, 0.0 * p))
    assert repeats([replace(one, recording=still)]) == ()
