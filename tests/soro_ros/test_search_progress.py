"""The bar of `soro identify`: it counts searches, and grows where more laws help than it expects."""

import io

from rich.console import Console

from soro_lab.commands.search_progress import SearchProgress


def shown(stages, laws, is_terminal):
    text = io.StringIO()
    console = Console(file=text, force_terminal=is_terminal, width=120, legacy_windows=False)
    with SearchProgress(console, laws) as progress:
        for stage in stages:
            for cost in (2.0, 0.5):
                progress.show(stage, cost)
    return text.getvalue()


def test_a_terminal_sees_stage_cost_and_how_many_searches_are_done():
    text = shown(["rest", "linear", "creep", "all data"], 1, True)
    assert "all data: 0.5 after 2 simulations" in text
    assert "3 of about 8" in text


def test_the_bar_grows_where_more_is_searched_than_expected():
    assert "5 of about 6" in shown([str(k) for k in range(6)], 0, True)


def test_a_file_gets_a_line_in_each_ten_seconds_of_a_search():
    text, times = io.StringIO(), iter([0.0, 4.0, 11.0, 12.0, 30.0, 31.0])
    with SearchProgress(Console(file=text, width=120), 0, lambda: next(times)) as progress:
        for cost in (9.0, 8.0, 7.0, 6.0, 5.0):
            progress.show("linear", cost)
        progress.show("all data", 4.0)
    assert text.getvalue().splitlines() == [
        "linear",
        "linear: 7 after 3 simulations, 11 s",
        "linear: 5 after 5 simulations, 30 s",
        "all data",
    ]


def test_a_file_gets_a_line_for_each_search():
    assert shown(["rest", "linear", "all data"], 0, False).splitlines() == ["rest", "linear", "all data"]
