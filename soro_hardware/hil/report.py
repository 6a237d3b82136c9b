"""Reports of procedures: Markdown, JSON and pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from soro_hardware.finding import Finding
from soro_hardware.hil.latency import Latency, Times, response
from soro_hardware.hil.paced import CycleSample
from soro_hardware.hil.plan import NOT_EXAMINED, HilPlan, ProcedureState


def verdict(findings: Sequence[Finding]) -> str:
    """Return FAILED, INCOMPLETE if a chamber was left out, else passed."""
    if any(finding.level == "fail" for finding in findings):
        return "FAILED"
    return "INCOMPLETE" if any(finding.name == NOT_EXAMINED for finding in findings) else "passed"


def markdown(title: str, about: Mapping[str, str], plan: HilPlan, state: ProcedureState) -> str:
    """Return the report of a first pressurisation as Markdown.

    Parameters
    ----------
    title : str
    about : mapping of str to str
        Facts about the procedure: platform, date and so on.
    plan : HilPlan
        Steps and expectations.
    state : ProcedureState
        State at the end.
    """
    lines = [
        f"# {title}",
        "",
        f"**{verdict(state.findings)}**",
        "",
        *(f"- {key}: {value}" for key, value in about.items()),
    ]
    rows = [(f.level, f.name, f.found, f.do) for f in state.findings]
    lines += ["", *table(("", "what", "found", "what to do"), rows)]
    head = (
        "chamber",
        "set point [kPa]",
        "reading [kPa]",
        "63 % after [ms]",
        "drift [kPa/s]",
        "tip moved [mm]",
    )
    steps = [
        (
            plan.expected.names[hold.chamber],
            f"{hold.setpoint_pa / 1e3:g}",
            f"{hold.level_pa[hold.chamber] / 1e3:.2f}",
            _number(hold.t63_s * 1e3, "{:.0f}"),
            f"{hold.drift_pa_s / 1e3:+.2f}",
            "-" if hold.moved_m is None else f"{np.linalg.norm(hold.moved_m) * 1e3:.1f}",
        )
        for hold in state.holds
    ]
    return "\n".join([*lines, "", *table(head, steps), ""])


LATENCY_HEAD = (
    "chamber",
    "steps up and down",
    "command to set point p50 / p99 / max [ms]",
    "first moved p50 / p99 / max [ms]",
    "63 % up / down [ms]",
    "dead time [ms]",
    "lag [ms]",
)


def latency_rows(latency: Latency) -> list[tuple[str, ...]]:
    """Return the rows of a table with the head `LATENCY_HEAD`, one for each chamber."""
    return [
        (
            chamber.name,
            str(chamber.steps),
            milliseconds(chamber.waited),
            milliseconds(chamber.moved),
            f"{chamber.t63_up_s * 1e3:.1f} / {chamber.t63_down_s * 1e3:.1f}",
            f"{chamber.dead_s * 1e3:.1f}",
            f"{chamber.lag_s * 1e3:.1f}",
        )
        for chamber in latency.chambers
    ]


def milliseconds(times: Times) -> str:
    """Return median, 99th percentile and maximum as text [ms]."""
    return f"{times.p50_s * 1e3:.2f} / {times.p99_s * 1e3:.2f} / {times.max_s * 1e3:.2f}"


def latency_markdown(title: str, about: Mapping[str, str], latency: Latency, found: Sequence[Finding]) -> str:
    """Return the report of latencies as Markdown.

    Parameters
    ----------
    title, about : str, mapping of str to str
        As in `markdown`.
    latency : Latency
        Measured latencies.
    found : sequence of Finding
        Comparison with the platform's model.
    """
    lines = [f"# {title}", "", *(f"- {key}: {value}" for key, value in about.items())]
    lines += [
        f"- set points sent to readings exchanged, p50 / p99 / max: {milliseconds(latency.exchange)} ms"
    ]
    lines += ["", *table(LATENCY_HEAD, latency_rows(latency))]
    lines += [
        "",
        *table(("", "what", "found", "what to do"), [(f.level, f.name, f.found, f.do) for f in found]),
    ]
    return "\n".join([*lines, ""])


def latency_json(about: Mapping[str, str], latency: Latency) -> str:
    """Return the latencies as JSON."""
    chambers = [{k: v for k, v in vars(c).items() if k not in ("time_s", "change")} for c in latency.chambers]
    return as_json({**about, **vars(latency), "chambers": chambers})


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table."""
    body = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return ["| " + " | ".join(head) + " |", "| " + " | ".join("---" for _ in head) + " |", *body]


def as_json(value: object) -> str:
    """Return results as JSON; values that are not finite are null."""
    return json.dumps(_plain(value), indent=2)


def first_pressure_json(about: Mapping[str, str], plan: HilPlan, state: ProcedureState) -> str:
    """Return the report of a first pressurisation as JSON; parameters as in `markdown`."""
    return as_json(
        {
            "passed": verdict(state.findings) == "passed",
            **about,
            "chambers": plan.expected.names,
            "config": plan.config.model_dump(),
            "findings": [finding._asdict() for finding in state.findings],
            "rest": state.rest,
            "holds": state.holds,
            "vents": state.vents,
        }
    )


def draw_first_pressure(file: Path, title: str, plan: HilPlan, samples: Sequence[CycleSample]) -> None:
    """Draw set points and readings of every chamber, and the path of the tip.

    Parameters
    ----------
    file : Path
        File of the picture.
    title : str
    plan : HilPlan
        Steps and expectations.
    samples : sequence of CycleSample
        All samples.
    """
    t = np.array([sample.t_s for sample in samples])
    sent = np.array([sample.sent_pa for sample in samples]) / 1e3
    read = np.array([sample.reading_pa for sample in samples]) / 1e3
    tips = [sample.tip_m for sample in samples]
    bending = plan.expected.bending
    has_tip = bending is not None and any(tip is not None for tip in tips)
    n = len(plan.expected.names)
    figure = Figure(figsize=(13 if has_tip else 9, 2.1 * n + 1.2), layout="constrained")
    grid = figure.add_gridspec(n, 2 if has_tip else 1, width_ratios=[2, 1.15] if has_tip else [1])
    first = None
    for k, name in enumerate(plan.expected.names):
        axes = figure.add_subplot(grid[k, 0], sharex=first, sharey=first)
        first = first or axes
        axes.plot(t, read[:, k], color=f"C{k}", lw=0.9, label="reading")
        axes.plot(t, sent[:, k], color="0.25", lw=0.9, ls="--", label="set point sent")
        axes.set(ylabel="pressure [kPa]", title=name)
        axes.grid(alpha=0.3)
        if k == 0:
            axes.legend(loc="upper right", fontsize="small")
    if first is not None:
        axes.set_xlabel("time [s]")
    if has_tip and bending is not None:
        _draw_tips(figure.add_subplot(grid[:, 1]), plan, samples)
    figure.suptitle(title)
    figure.savefig(file, dpi=110)


def draw_latency(file: Path, title: str, latency: Latency) -> None:
    """Draw all steps up of each chamber superimposed, with the fitted response.

    Parameters
    ----------
    file : Path
        File of the picture.
    title : str
    latency : Latency
        Measured latencies.
    """
    n = len(latency.chambers)
    columns = min(n, 4)
    rows = -(-n // columns)
    figure = Figure(figsize=(4.4 * columns, 4.4 * rows), layout="constrained")
    first = None
    for k, chamber in enumerate(latency.chambers):
        axes = figure.add_subplot(rows, columns, k + 1, sharex=first, sharey=first)
        first = first or axes
        axes.plot(chamber.time_s * 1e3, chamber.change, ".", color=f"C{k}", ms=3, alpha=0.5, label="readings")
        t = np.linspace(0.0, float(chamber.time_s.max(initial=0.1)), 400)
        fit = response(t, chamber.dead_s, chamber.lag_s, chamber.gain)
        text = f"dead time {chamber.dead_s * 1e3:.1f} ms, lag {chamber.lag_s * 1e3:.1f} ms"
        axes.plot(t * 1e3, fit, "k-", lw=1.2, label=text)
        axes.axvline(chamber.moved.p50_s * 1e3, color="C3", ls="--", lw=1, label="first moved, median")
        axes.set(
            xlabel="time since the set point was sent [ms]", title=f"{chamber.name}, {chamber.steps} steps"
        )
        axes.grid(alpha=0.3)
        axes.legend(loc="lower right", fontsize="small")
        if k % columns == 0:
            axes.set_ylabel("change of the reading, part of the step")
    figure.suptitle(f"{title}; exchange p50 / p99 / max {milliseconds(latency.exchange)} ms")
    figure.savefig(file, dpi=110)


def _draw_tips(axes: Any, plan: HilPlan, samples: Sequence[CycleSample]) -> None:
    """Draw the path of the tip normal to the axis of the base for each chamber, and the model's positions."""
    bending = plan.expected.bending
    assert bending is not None
    origin = next(sample.tip_m for sample in samples if sample.tip_m is not None)
    for k, name in enumerate(plan.expected.names):
        way = [s.tip_m - origin for s in samples if s.tip_m is not None and s.sent_pa[k] > 0]
        if way:
            axes.plot(*(bending.across @ np.array(way).T * 1e3), color=f"C{k}", lw=1.2, label=name)
        model = bending.expected_m[k] * 1e3
        axes.plot(model[:, 0], model[:, 1], "o", mfc="none", color=f"C{k}", ms=7)
    axes.plot([], [], "o", mfc="none", color="0.3", label="model, at each step")
    axes.set(xlabel="x of the base [mm]", ylabel="y of the base [mm]", title="tip", aspect="equal")
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize="small")


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


def _number(value: float, form: str) -> str:
    return form.format(value) if math.isfinite(value) else "-"
