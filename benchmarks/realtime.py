"""Real-time factor on the bent release, at an error of at most 0.1 % of the length."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from benchmarks import peer, peer_release, release
from benchmarks.options import Options
from benchmarks.release import Found, Reference
from benchmarks.report import figure, met, table
from benchmarks.timing import per_call

TITLE = "Real-time factor"
# Times real time to reach, and how many times the peer's.
FACTOR = {1: 300.0, 2: 120.0, 4: 50.0, 8: 20.0}
RATIO = {1: 3.0, 2: 5.0, 4: 10.0, 8: 15.0}


def run(options: Options) -> str:
    """Measure and write."""
    rows, all_ours, all_theirs, own = [], [], [], []
    t_end = options.pick(1.0, 0.05)
    for n in options.pick((1, 2, 4, 8), (1,)):
        options.say(f"{n} links, reference")
        reference = Reference(n, t_end)
        own.append(f"{n}: {figure(reference.own_error, 2)} %")
        mine = release.best_of_ours(reference, n, options.pick((2, 3, 4, 5, 6), (4,)), options.say)
        theirs = peer_release.search(reference, n, options.say) if options.peer else []
        all_ours += [cells(n, one, t_end) for one in by_time(mine)]
        all_theirs += [cells(n, one, t_end) for one in by_time(theirs)]
        rows.append(duel(n, release.fastest(mine), release.fastest(theirs), t_end, options.repeats))
    return text(rows, all_ours, all_theirs, own, options.peer)


def by_time(found: Iterable[Found]) -> list[Found]:
    """Fastest first."""
    return sorted(found, key=lambda one: one.seconds)


def cells(n: int, found: Found, t_end: float) -> list[object]:
    """Row of a list of methods."""
    one = found.candidate
    return [n, one.method, one.setting, figure(found.error, 2), figure(t_end / found.seconds)]


def duel(n: int, mine: Found | None, other: Found | None, t_end: float, repeats: int) -> list[object]:
    """Measure the two best once more, in turns."""
    if mine is None:
        return [n, "none accurate enough", "-", "-", "-", "-", "-", "-"]
    runs = {"ours": again(mine)}
    if other is not None:
        runs["peer"] = again(other)
    times = per_call(runs, repeats, sample_s=0.0)
    factor = t_end / times["ours"]
    row: list[object] = [
        n,
        f"{mine.candidate.method}, {mine.candidate.setting}",
        figure(mine.error, 2),
        figure(factor),
        f"{FACTOR[n]:g} ({met(factor >= FACTOR[n])})",
    ]
    if other is None:
        return [*row, "-", "-", "-"]
    ratio = times["peer"] / times["ours"]
    return [
        *row,
        f"{other.candidate.method}, {other.candidate.setting} ({figure(other.error, 2)} %)",
        figure(t_end / times["peer"]),
        f"{figure(ratio)}, to reach {RATIO[n]:g} ({met(ratio >= RATIO[n])})",
    ]


def again(found: Found) -> Callable[[int], None]:
    """Run of n calls."""

    def run(n: int) -> None:
        for _ in range(n):
            found.candidate.run()

    return run


def text(
    rows: list[list[object]],
    all_ours: list[list[object]],
    all_theirs: list[list[object]],
    own: list[str],
    full: bool,
) -> str:
    """Markdown of the section."""
    head = ["links", "ours", "error, %", "times real time", "to reach", "soromox", "times real time", "ratio"]
    each = ["links", "method", "setting", "error, %", "times real time"]
    parts = [
        "Bent release (quarter circle, hanging, 1 s), three strains a link: the fastest setting whose tip "
        f"RMSE is at most {release.LIMIT:g} % of the length against the same model converged (whose own "
        f"error by links is {', '.join(own)}). Quadrature alone may leave a third of that, so that its error "
        f"and that of time do not cancel by chance. {'' if full else peer.MISSING}",
        table(head, rows),
        "Each of our steppers at its fastest good setting:",
        table(each, all_ours),
    ]
    if all_theirs:
        parts += ["Each solver of soromox and diffrax at its fastest good setting:", table(each, all_theirs)]
    return "\n\n".join(parts)
