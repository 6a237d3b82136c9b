"""The page of a report, in the order in which a reader asks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

from soro_lab.identification.arm.report import tables
from soro_lab.identification.arm.report.fit_pictures import (
    correlation_picture,
    laws_picture,
    profiles_picture,
)
from soro_lab.identification.arm.report.run_pictures import histogram, run_picture
from soro_lab.identification.arm.report.tables import Content
from soro_lab.identification.arm.report.traces import Trace
from soro_lab.reporting.html import PAGE, bullets, picture, words

_CHAPTERS = (
    ("data", "Data"),
    ("errors", "Error of every run"),
    ("runs", "Measured and predicted"),
    ("laws", "Laws"),
    ("numbers", "Numbers"),
    ("open", "What the data do not determine"),
    ("repeats", "How well the arm repeats"),
    ("frames", "Frames of the measurement"),
)


def page(content: Content, traces: Sequence[Trace]) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    content : dict
        Of report.json.
    traces : sequence of Trace
    """
    own = {
        "data": _data(content),
        "errors": _errors(content, traces),
        "runs": _runs(content, traces),
        "laws": _laws(content),
        "numbers": _numbers(content),
        "open": _open(content),
        "repeats": _repeats(content),
        "frames": [tables.frames_table(content)],
    }
    parts = [*_begin(content)]
    for key, title in _CHAPTERS:
        parts += [f'<h2 id="{key}">{escape(title)}</h2>', *own[key]]
    title = f"Identification of {content['robot']}"
    return PAGE.substitute(title=escape(title), body="\n".join(parts))


def _begin(content: Content) -> Iterator[str]:
    verdict = content["verdict"]
    yield f"<h1>Identification of {escape(content['robot'])}</h1>"
    yield words(f"Robot file: {content['file']}. All numbers of this page: report.json.", kind="soft")
    text = verdict["text"][:1].upper() + verdict["text"][1:]
    yield f'<div class="verdict{" good" if verdict["accepted"] else ""}">{escape(text)}</div>'
    yield "<h3>What to do next</h3>" + bullets(verdict["next"])
    yield "<nav>" + "".join(f'<a href="#{key}">{escape(title)}</a>' for key, title in _CHAPTERS) + "</nav>"


def _data(content: Content) -> Iterator[str]:
    yield tables.data_table(content)
    yield words("Sections: the laws are chosen by those held out, which the fit before has not seen.")
    yield tables.sections_table(content)


def _errors(content: Content, traces: Sequence[Trace]) -> Iterator[str]:
    off = [f"{run['run']}, {run['shape']}: {run['why']}" for run in content["runs"] if run["written_off"]]
    if off:
        yield '<p class="warn">The fit hardly follows these runs:</p>' + bullets(off)
    yield words(
        "Over each whole run. Beyond three: the share of samples more than three expected errors off. "
        "Weight: how much the samples count in the fit on average; the soft loss takes it from samples that "
        "are far off.",
        kind="soft",
    )
    yield tables.runs_table(content)
    yield words("Sections of the fit and those held out, apart:", kind="soft")
    yield tables.errors_table(content)
    yield picture(
        histogram(traces),
        "Histogram of what is left over, beside the normal distribution",
        "; ".join(
            f"{each['shape']}: mean {each['mean']:.2g}, deviation {each['deviation']:.2g}, "
            f"{100 * each['beyond_three']:.2g} % beyond three (normal: 0, 1, 0.27 %)"
            for each in content["residuals"]
        ),
    )


def _runs(content: Content, traces: Sequence[Trace]) -> Iterator[str]:
    if any(run["held_out_s"] for run in content["data"]):
        yield words(
            "Predicted with the numbers of the fit that has not seen the shaded sections. Each run is "
            "simulated from its first balance under its measured pressures.",
            kind="soft",
        )
    else:
        yield words("Predicted with the numbers of the fit on all data: nothing is held out.", kind="soft")
    for trace in traces:
        yield f"<h3>{escape(trace.run)}, {escape(trace.shape)}</h3>"
        yield picture(run_picture(trace), f"Measured and predicted {trace.shape} of {trace.run} over time")


def _laws(content: Content) -> Iterator[str]:
    if not content["laws"]:
        yield words("The linear law: nothing could be held out, so no other was tried.")
        return
    yield picture(
        laws_picture(content["laws"], content["verdict"]["accept_share"]),
        "Error on held-out sections of each set of laws",
        "Whiskers: one standard error of the difference to the best. The simplest set within one of them, or "
        "within 3 % of the best, is chosen.",
    )


def _numbers(content: Content) -> Iterator[str]:
    yield tables.numbers_table(content)
    yield words(
        "Deviation: of the logarithm, in %, for positive quantities. Prior: the described robot, and the "
        "doubt of it. A number at its bound has no deviation: it is a finding about the model.",
        kind="soft",
    )
    yield "<h3>Correlations</h3>" + picture(
        correlation_picture(content["correlation"]),
        "Correlation matrix of all numbers",
        "Numbers near +1 or -1 are known in combination only.",
    )
    own = [each for each in content["profiles"] if not each["name"].startswith("frame/")]
    if own:
        yield "<h3>Profiles</h3>" + picture(
            profiles_picture(own),
            "Profile of each number of the arm",
            "Each number is held off its value and all others follow. Red: with simulations; blue: with "
            "residuals linear in the numbers; dotted: the data alone; dashed: the parabola of the deviation.",
        )
        yield tables.profiles_table({"profiles": own})


def _open(content: Content) -> Iterator[str]:
    if content["verdict"]["interrupted"]:
        yield words("Not examined: the search was interrupted.")
    else:
        yield (
            tables.open_table(content) if content["undetermined"] else words("Nothing: all are determined.")
        )
    if content["combinations"]:
        yield words("These ratios (:) and products (*) are surer than each of their two numbers:")
        yield tables.combinations_table(content)


def _repeats(content: Content) -> Iterator[str]:
    if not content["repeats"]:
        yield words(
            "No pressures were visited twice, so the floor of the error is not known from these data."
        )
        return
    yield words(
        "Spread between times with the same pressures (within 1 % of the range, now and over the second "
        "before): no prediction from pressures has a smaller error there.",
        kind="soft",
    )
    yield tables.repeats_table(content)
