"""Known regulators and valves come back from their noisy responses; the models meet the measured ones."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.pneumatics import RegulatorModel, ValveModel
from soro_core.twin.config import TwinConfig
from soro_lab.identification import regulator_fit as air
from soro_lab.identification.air_picture import draw
from soro_lab.identification.steps import FoundSteps, Step, crossing, find_steps, read_pressures
from soro_lab.identification.valves import (
    FlowModel,
    Response,
    fit_flow,
    fit_regulator,
    flow_response,
    judge,
    regulator_response,
)
from tests.refused import fails

LEVELS = ((7e3, 69e3), (69e3, 7e3), (7e3, 103e3), (103e3, 7e3), (34e3, 7e3))
VALVE = FlowModel(
    ValveModel(fill_m3_s_pa=1.2e-10, vent_m3_s_pa=0.9e-10, supply_pa=200e3, band_pa=15e3, vent_band_pa=25e3),
    30e-6,
    0.1,
    0.4,
)
LAG = RegulatorModel(delay_s=0.12, tau_s=0.35, vent_tau_s=1.1)


def steps(
    respond: Callable[[list[Step], np.ndarray], Response], run: str = "r", seed: int = 3, seconds: float = 6.0
) -> list[Step]:
    """Steps between levels as a noisy sensor with repeated and missing readings shows them."""
    empty = np.empty(0)
    bare = [Step(run, "a", pair, *pair, empty, empty, np.nan, 300.0) for pair in LEVELS]
    t, pressure = respond(bare, np.linspace(0.0, seconds, 151))
    rng = np.random.default_rng(seed)
    measured = []
    for pair, clean in zip(LEVELS, pressure.T, strict=True):
        kept = np.sort(rng.choice(len(t), 120, replace=False))
        noisy = clean[kept] + rng.normal(scale=300.0, size=kept.size)
        t63 = crossing(t, (clean - pair[0]) / (pair[1] - pair[0]))
        measured.append(Step(run, "a", pair, *pair, t[kept], noisy, t63, 300.0))
    return measured


def test_a_known_lag_comes_back() -> None:
    model, found = fit_regulator(steps(lambda bare, t: regulator_response(LAG, bare, t)))
    assert found.converged, found.message
    assert model.delay_s == pytest.approx(LAG.delay_s, abs=0.005)
    assert model.tau_s == pytest.approx(LAG.tau_s, rel=0.02)
    assert model.vent_tau_s == pytest.approx(LAG.vent_tau_s, rel=0.02)
    assert model.reading_noise_pa == pytest.approx(300.0)
    assert model.maximum_pa == 103e3


def test_a_fast_regulator_comes_back_too() -> None:
    fast = RegulatorModel(delay_s=0.005, tau_s=0.052)
    model, _ = fit_regulator(steps(lambda bare, t: regulator_response(fast, bare, t), seconds=0.4))
    assert model.delay_s == pytest.approx(0.005, abs=0.001)
    assert model.tau_s == pytest.approx(0.052, rel=0.03)
    assert model.vent_tau_s == pytest.approx(0.052, rel=0.03)


def test_a_known_valve_comes_back() -> None:
    model, found = fit_flow(steps(lambda bare, t: flow_response(VALVE, bare, t)), 30e-6, 200e3)
    assert found.converged, found.message
    assert model.valves.fill_m3_s_pa == pytest.approx(VALVE.valves.fill_m3_s_pa, rel=0.02)
    assert model.valves.vent_m3_s_pa == pytest.approx(VALVE.valves.vent_m3_s_pa, rel=0.02)
    assert model.valves.band_pa == pytest.approx(VALVE.valves.band_pa, rel=0.05)
    assert model.valves.vent_band_pa == pytest.approx(VALVE.valves.vent_band_pa, rel=0.05)
    assert model.delay_s == pytest.approx(VALVE.delay_s, abs=0.005)
    assert model.vent_delay_s == pytest.approx(VALVE.vent_delay_s, abs=0.01)


def test_only_conductance_over_volume_shows() -> None:
    measured = steps(lambda bare, t: flow_response(VALVE, bare, t))
    small, _ = fit_flow(measured, 30e-6, 200e3)
    large, _ = fit_flow(measured, 60e-6, 200e3)
    assert large.valves.fill_m3_s_pa == pytest.approx(2 * small.valves.fill_m3_s_pa, rel=1e-3)


def test_one_lag_cannot_fill_and_vent_at_once_and_says_so() -> None:
    measured = steps(lambda bare, t: flow_response(VALVE, bare, t))
    one, _ = fit_regulator(measured, directional=False)
    flow, _ = fit_flow(measured, 30e-6, 200e3)
    lagging = air.score(judge(measured, regulator_response(one, measured)), fill=True)
    flowing = air.score(judge(measured, flow_response(flow, measured)), fill=True)
    assert lagging is not None
    assert flowing is not None
    assert lagging.median > 0.5
    assert lagging.within == 0
    assert flowing.median < 0.05
    assert flowing.within == flowing.n == 2


def test_a_model_that_never_gets_there_fails() -> None:
    (judged, *_) = judge(
        steps(lambda bare, t: regulator_response(LAG, bare, t)),
        (np.array([0.0, 6.0]), np.tile([7e3, 69e3, 7e3, 103e3, 34e3], (2, 1))),
    )
    assert judged.error == np.inf


def test_each_run_is_judged_by_the_others() -> None:
    slow = LAG.model_copy(update={"tau_s": 0.7})
    first = steps(lambda bare, t: regulator_response(LAG, bare, t), run="1")
    second = steps(lambda bare, t: regulator_response(slow, bare, t), run="2")
    kind = air.kinds(30e-6, 200e3)[1]
    fitted = air.fit_air([*first, *second], kind)
    errors = [one.t63_s / one.step.t63_s - 1 for one in fitted.held_out if one.step.fill]
    # Run 1 by the times of run 2, and the other way round.
    fast_s, slow_s = LAG.delay_s + LAG.tau_s, LAG.delay_s + slow.tau_s
    expected = 2 * [slow_s / fast_s - 1] + 2 * [fast_s / slow_s - 1]
    assert errors == pytest.approx(expected, abs=0.05)
    assert air.score(fitted.own, True).n == air.score(fitted.held_out, True).n == 4
    alone = air.fit_air(first, kind)
    # Of one run every second fill and vent is held out.
    assert air.score(alone.held_out, True).n == 2
    assert max(one.error for one in alone.held_out) < 0.05
    nothing = air.fit_air([step for step in first if step.fill][:1], kind)
    assert not nothing.held_out
    assert [row[3:] for row in air.rows([nothing])][1] == ["-"] * 6


def test_blocks_are_parameters_of_the_models() -> None:
    regulator = air.block(LAG)["regulator"]
    assert RegulatorModel.model_validate(regulator) == LAG
    flow = air.block(VALVE)
    assert TwinConfig.model_validate(flow["twin"]).valve == VALVE.valves
    assert flow["for"]["vent_delay_s"] == 0.4


def test_nothing_to_fit_is_refused() -> None:
    with fails(ModelError, key="steps"):
        fit_flow([], 30e-6, 200e3)


@pytest.fixture(scope="module")
def measured(data: Path) -> FoundSteps:
    folder = data / "asu_two_segment"
    if not folder.is_dir():
        pytest.skip(f"no data set in {folder} (set SORO_DATA)")
    found = FoundSteps((), Counter(), 0, 0, 0)
    for path in sorted(folder.glob("*.csv")):
        found += find_steps(read_pressures(path))
    return found


def test_measured_steps_are_those_of_slow_regulators(measured: FoundSteps) -> None:
    assert len(measured.steps) > 150
    assert measured.stale > 0.3 * measured.rows
    for fill, seconds in ((True, 0.6), (False, 1.6)):
        times = [step.t63_s for step in measured.steps if step.fill == fill]
        assert np.median(times) == pytest.approx(seconds, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("which", [1, 5])
def test_models_meet_measured_steps_of_runs_not_seen(
    measured: FoundSteps, which: int, figure: Callable[[str], None], tmp_path: Path
) -> None:
    """The lag with a time constant for each way, of all lines; and the flow with two bands, of each."""
    kind = air.kinds(30e-6, 200e3)[which]
    fitted = air.fit_air(measured.steps, kind)
    for fill in (True, False):
        result = air.score(fitted.held_out, fill)
        assert result is not None
        figure(
            f"{kind.name}: t63 of {'fills' if fill else 'vents'} in runs not seen: median error "
            f"{100 * result.median:.0f} %, {result.within} of {result.n} within 20 %"
        )
        assert result.median <= 0.2
    draw(tmp_path / "fit.png", measured.steps, [fitted])
    assert (tmp_path / "fit.png").stat().st_size > 10_000


def test_one_lag_does_not_meet_measured_fills(measured: FoundSteps) -> None:
    model, _ = fit_regulator(measured.steps, directional=False)
    result = air.score(judge(measured.steps, regulator_response(model, measured.steps)), fill=True)
    assert result is not None
    assert result.median > 0.5
