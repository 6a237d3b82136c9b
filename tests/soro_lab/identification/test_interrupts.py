"""Ctrl-C between two searches ends the next one; what was found is kept."""

import signal

import pytest
from made_arm import record

from soro_core import load_robot
from soro_lab.identification.arm import stages
from soro_lab.identification.arm.cases.parameters import with_numbers
from soro_lab.identification.arm.laws import LAWS, plain
from soro_lab.identification.search import only_in_searches, searching


def test_ctrl_c_between_searches_keeps_what_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    guess = with_numbers(plain(load_robot("tue_three_bellow")), {"link0/damping_b": 1e-7})
    recording = record(with_numbers(guess, {"link0/k_b": 7.5e-3}), hold_s=0.6)
    errors = stages.residual_errors

    def interrupted(*given):
        signal.raise_signal(signal.SIGINT)
        return errors(*given)

    # After the linear law has been fitted, before others are tried.
    monkeypatch.setattr(stages, "residual_errors", interrupted)
    options = stages.IdentificationOptions(dt_s=0.01, rate_hz=10.0, laws=LAWS[:1], is_constant=True, starts=1)
    found = stages.identify(guess, [recording], options)
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
