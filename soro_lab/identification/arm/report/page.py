"""The page of a report, in the order in which a reader asks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from soro_lab.identification.arm.report import tables
from soro_lab.identification.arm.report.fit_pictures import (
    correlation_picture,
    histogram,
    laws_picture,
    profiles_picture,
    run_picture,
)
from soro_lab.identification.arm.report.tables import Content
from soro_lab.identification.arm.report.traces import ShapeTrace
from soro_lab.reporting.html import Block, Bullets, Chapter, Heading, Page, Picture, Words


def page_of(content: Content, traces: Sequence[ShapeTrace]) -> Page:
    """Return the page of the content of report.json."""
    verdict = content["verdict"]
    return Page(
        f"Identification of {content['robot']}",
        f"Robot file: {content['file']}. All numbers of this page: report.json.",
        verdict["text"],
        verdict["accepted"],
        [Heading("What to do next"), Bullets(verdict["next"])],
        [
            Chapter("data", "Data", [*_data(content)]),
            Chapter("errors", "Error of every run", [*_errors(content, traces)]),
            Chapter("runs", "Measured and predicted", [*_runs(content, traces)]),
            Chapter("laws", "Laws", [*_laws(content)]),
            Chapter("numbers", "Numbers", [*_numbers(content)]),
            Chapter("open", "What the data do not determine", [*_open(content)]),
            Chapter("repeats", "How well the arm repeats", [*_repeats(content)]),
            Chapter("frames", "Frames of the measurement", tables.frames_tables(content)),
        ],
    )


def _data(content: Content) -> Iterator[Block]:
    yield tables.data_table(content)
    yield Words("Sections: the laws are chosen by those held out, which the fit before has not seen.")
    yield tables.sections_table(content)


def _errors(content: Content, traces: Sequence[ShapeTrace]) -> Iterator[Block]:
    off = [f"{run['run']}, {run['shape']}: {run['why']}" for run in content["runs"] if run["written_off"]]
    if off:
        yield Words("The fit hardly follows these runs:", kind="warn")
        yield Bullets(off)
    yield Words(
        "Over each whole run. Beyond three: the share of samples more than three expected errors off. "
        "Weight: how much the samples count in the fit on average; the soft loss takes it from samples that "
        "are far off.",
        kind="soft",
    )
    yield tables.runs_table(content)
    yield Words("Sections of the fit and those held out, apart:", kind="soft")
    yield tables.errors_table(content)
    yield Picture(
        histogram(traces),
        "Histogram of what is left over, beside the normal distribution",
        "; ".join(
            f"{each['shape']}: mean {each['mean']:.2g}, deviation {each['deviation']:.2g}, "
            f"{100 * each['beyond_three']:.2g} % beyond three (normal: 0, 1, 0.27 %)"
            for each in content["residuals"]
        ),
    )


def _runs(content: Content, traces: Sequence[ShapeTrace]) -> Iterator[Block]:
    if any(run["held_out_s"] for run in content["data"]):
        yield Words(
            "Predicted with the numbers of the fit that has not seen the shaded sections. Each run is "
            "simulated from its first equilibrium under its measured pressures.",
            kind="soft",
        )
    else:
        yield Words("Predicted with the numbers of the fit on all data: nothing is held out.", kind="soft")
    for trace in traces:
        yield Heading(f"{trace.run}, {trace.shape}")
        yield Picture(run_picture(trace), f"Measured and predicted {trace.shape} of {trace.run} over time")


def _laws(content: Content) -> Iterator[Block]:
    if not content["laws"]:
        yield Words("The linear law: nothing could be held out, so no other was tried.")
        return
    yield Picture(
        laws_picture(content["laws"], content["verdict"]["accept_share"]),
        "Error on held-out sections of each set of laws",
        "Whiskers: one standard error of the difference to the best. The simplest set within one of them, or "
        "within 3 % of the best, is chosen.",
    )


def _numbers(content: Content) -> Iterator[Block]:
    yield tables.numbers_table(content)
    yield Words(
        "Deviation: of the logarithm, in %, for positive quantities. Prior: the described robot, and the "
        "doubt of it. A number at its bound has no deviation: it is a finding about the model.",
        kind="soft",
    )
    yield Heading("Correlations")
    yield Picture(
        correlation_picture(content["correlation"]),
        "Correlation matrix of all numbers",
        "Numbers near +1 or -1 are known in combination only.",
    )
    own = [each for each in content["profiles"] if not each["name"].startswith("frame/")]
    if own:
        yield Heading("Profiles")
        yield Picture(
            profiles_picture(own),
            "Profile of each number of the arm",
            "Each number is held off its value and all others follow. Red: with simulations; blue: with "
            "residuals linear in the numbers; dotted: the data alone; dashed: the parabola of the deviation.",
        )
        yield tables.profiles_table({"profiles": own})


def _open(content: Content) -> Iterator[Block]:
    if content["verdict"]["interrupted"]:
        yield Words("Not examined: the search was interrupted.")
    else:
        yield (
            tables.open_table(content) if content["undetermined"] else Words("Nothing: all are determined.")
        )
    if content["combinations"]:
        yield Words("These ratios (:) and products (*) are surer than each of their two numbers:")
        yield tables.combinations_table(content)


def _repeats(content: Content) -> Iterator[Block]:
    if not content["repeats"]:
        yield Words(
            "No pressures were visited twice, so the floor of the error is not known from these data."
        )
        return
    yield Words(
        "Spread between times with the same pressures (within 1 % of the range, now and over the second "
        "before): no prediction from pressures has a smaller error there.",
        kind="soft",
    )
    yield tables.repeats_table(content)
