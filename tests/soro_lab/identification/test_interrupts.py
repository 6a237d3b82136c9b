"""Ctrl-C between two searches ends the next one; what was found is kept."""

import signal

import pytest
from made_arm import record

from soro_core import load_robot
from soro_core.jobs import Here, Threads
from soro_lab.identification.arm import stages
from soro_lab.identification.arm.cases.parameters import with_numbers
from soro_lab.identification.arm.laws import LAWS, LawTerm, plain
from soro_lab.identification.search import EndedSearchError, end_if_interrupted, only_in_searches, searching


def identified(executor=None, laws=LAWS[:1], most=3):
    guess = with_numbers(plain(load_robot("tue_three_bellow")), {"link0/damping_b": 1e-7})
    recording = record(with_numbers(guess, {"link0/k_b": 7.5e-3}), hold_s=0.6)
    options = stages.IdentificationOptions(
        dt_s=0.01, rate_hz=10.0, laws=laws, most=most, is_constant=True, starts=1, executor=executor
    )
    return stages.identify(guess, [recording], options)


def searched(item):
    with searching():
        end_if_interrupted()
    return item


class FitsOfLaws(Threads):
    """Threads that note the laws whose fits are jobs; Ctrl-C comes with one of these."""

    def __init__(self, jobs, interrupted_at=None):
        super().__init__(jobs)
        self.width, self.laws, self.interrupted_at = jobs, [], interrupted_at

    def submit(self, function, item):
        if isinstance(item, tuple) and item and isinstance(item[0], LawTerm):
            if len(self.laws) == self.interrupted_at:
                signal.raise_signal(signal.SIGINT)
            self.laws.append([law.name for law in item])
        return super().submit(function, item)


@pytest.mark.slow
def test_sets_of_laws_are_fitted_as_jobs_with_the_same_numbers() -> None:
    alone = identified(Here(), LAWS[1:3])
    with FitsOfLaws(2) as executor:
        beside = identified(executor, LAWS[1:3])
    assert executor.laws[:2] == [["area slope"], ["saturating area"]]
    assert [(t.name, t.squares, t.values) for t in beside.choice.tried] == [
        (t.name, t.squares, t.values) for t in alone.choice.tried
    ]
    assert beside.solution.values == alone.solution.values
    assert beside.certainty.deviations == alone.certainty.deviations


@pytest.mark.slow
def test_ctrl_c_among_fits_of_laws_keeps_those_that_are_done() -> None:
    with FitsOfLaws(1, interrupted_at=1) as executor:
        found = identified(executor, LAWS[1:3])
    assert found.interrupted
    assert [trial.name for trial in found.choice.tried] == ["linear", "area slope"]


def test_a_search_in_a_thread_ends_after_ctrl_c() -> None:
    end_if_interrupted()
    with only_in_searches(), Threads(1) as executor:
        # A search in a thread leaves the mark of the one in the main thread.
        with pytest.raises(KeyboardInterrupt), searching():
            signal.raise_signal(executor.submit(searched, signal.SIGINT).result())
        assert isinstance(executor.submit(end_if_interrupted, 0.0).exception(), EndedSearchError)
        with searching():
            assert executor.submit(end_if_interrupted, 0.0).exception() is None


def test_ctrl_c_between_searches_keeps_what_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = stages.residual_errors

    def interrupted(*given):
        signal.raise_signal(signal.SIGINT)
        return errors(*given)

    # After the linear law has been fitted, before others are tried.
    monkeypatch.setattr(stages, "residual_errors", interrupted)
    found = identified(most=25)
    assert found.interrupted
    assert found.solution.values["link0/k_b"] == pytest.approx(7.5e-3, rel=0.1)


def test_a_second_ctrl_c_ends_the_work_too() -> None:
    before = signal.getsignal(signal.SIGINT)
    with only_in_searches():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) == before


def test_ctrl_c_ends_the_search_that_goes_on_or_the_next_one() -> None:
    with only_in_searches():
        with pytest.raises(KeyboardInterrupt), searching():
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt), searching():
            pytest.fail("the search begins")
        with searching():
            pass


def test_ctrl_c_after_the_last_search_leaves_the_searches_of_other_work_alone() -> None:
    with only_in_searches():
        signal.raise_signal(signal.SIGINT)
    try:
        with searching():
            pass
    except KeyboardInterrupt:
        pytest.fail("the signal of work that has ended came")
