"""The fit finds what made the data, in spite of outliers, and says what it cannot know."""

import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from benchmarks.segment_runs import forced_curvature, release_bend
from soro_core.errors import ConfigError, ModelError
from soro_core.model import SoftArm
from soro_core.robot import Robot, robot_from_dict
from soro_lab.identification import ForcedRun, Parameter, fit, residuals_or_none
from soro_lab.identification.search import LOSSES, Loss
from tests.refused import fails

TRUE = {"k_b": 7e-3, "gain": 1.3e-8, "damping": 3e-7}
START = (
    Parameter("k_b", 1e-2, 1e-3, 1e-1),
    Parameter("gain", 1e-8, 1e-9, 1e-7),
    Parameter("damping", 1e-7, 0.0, 1e-5),
)


def build(values: dict[str, float]) -> Robot:
    chambers = [
        {"angle_rad": 2 * math.pi * i / 3, "alpha_eps": 1e-6, "alpha_kappa": values["gain"]} for i in range(3)
    ]
    link = {
        "length": 0.064,
        "radius": 0.013,
        "mass": 0.017,
        "k_e": [400.0, 0.0, 0.0],
        "k_b": [values["k_b"], 0.0, 0.0],
        "damping": [0.01, values["damping"], values["damping"]],
        "chambers": chambers,
    }
    return robot_from_dict({"links": [link]})


def pressures(t: np.ndarray) -> np.ndarray:
    phase = 2 * np.pi * np.arange(3) / 3
    return 1e4 + 4e3 * (t[:, None] / 3) * (1 + np.sin(2 * t[:, None] - phase))


@pytest.fixture(scope="module")
def forced() -> ForcedRun:
    t = np.arange(0, 3, 0.02)
    run = ForcedRun(t, pressures(t), np.zeros((len(t), 2)))
    _, curvature = forced_curvature(SoftArm(build(TRUE)), run)
    return ForcedRun(t, run.pressure, curvature)


def residuals(forced: ForcedRun, release: np.ndarray):
    def of(values: dict[str, float]) -> np.ndarray:
        arm = SoftArm(build(values))
        _, curvature = forced_curvature(arm, forced)
        _, bend = release_bend(arm, 0.3, 0.3, dt=2e-3)
        return np.concatenate([((curvature - forced.curvature) / 0.1).ravel(), (bend - release) / 0.005])

    return of


def test_known_parameters_come_back(forced: ForcedRun) -> None:
    _, release = release_bend(SoftArm(build(TRUE)), 0.3, 0.3, dt=2e-3)
    found = fit(START, residuals(forced, release))
    assert found.converged, found.message
    for name, value in TRUE.items():
        assert found.values[name] == pytest.approx(value, rel=1e-3), name


def test_noise_and_outliers_spoil_nothing(forced: ForcedRun) -> None:
    rng = np.random.default_rng(1)
    _, release = release_bend(SoftArm(build(TRUE)), 0.3, 0.3, dt=2e-3)
    measured = forced.curvature + rng.normal(scale=0.05, size=forced.curvature.shape)
    measured[60:66, 1] += 8.0
    spoiled = ForcedRun(forced.t, forced.pressure, measured)
    noisy = release + rng.normal(scale=0.003, size=release.shape)
    robust = fit(START, residuals(spoiled, noisy))
    plain = fit(START, residuals(spoiled, noisy), loss="linear")
    gain = TRUE["gain"] / TRUE["k_b"]
    assert robust.values["gain"] / robust.values["k_b"] == pytest.approx(gain, rel=0.02)
    assert abs(plain.values["gain"] / plain.values["k_b"] / gain - 1) > 0.02


def test_what_the_data_do_not_determine_has_no_deviation() -> None:
    unknown = (Parameter("a", 1.0), Parameter("b", 1.0), Parameter("c", 1.0), Parameter("d", 2.0))
    noise = np.random.default_rng(3).normal(size=50)
    found = fit(unknown, lambda v: np.append(v["a"] - 2.0 + noise, v["c"] * v["d"] - 3.0 + noise))
    alone = fit(unknown[:1], lambda v: v["a"] - 2.0 + noise)
    assert found.values["a"] == pytest.approx(alone.values["a"], abs=1e-3)
    assert found.deviations["a"] == pytest.approx(alone.deviations["a"], rel=0.05)  # as without the others
    assert all(math.isinf(found.deviations[name]) for name in "bcd")
    assert found.message.endswith("; no effect on the data: b; with the same effect on the data: c, d")
    assert "effect" not in alone.message
    assert math.isinf(fit(unknown[1:2], lambda v: noise).deviations["b"])


def test_deviations_follow_the_noise() -> None:
    rng = np.random.default_rng(2)
    x = np.linspace(0, 1, 400)
    y = 3 * x + rng.normal(scale=0.1, size=x.size)
    found = fit((Parameter("slope", 1.0),), lambda v: v["slope"] * x - y, loss="linear")
    assert found.deviations["slope"] == pytest.approx(0.1 / math.sqrt((x**2).sum()), rel=0.1)


def test_a_candidate_that_fails_is_stepped_around() -> None:
    failed = []

    def of(values: dict[str, float]) -> np.ndarray:
        if values["a"] > 2.05:
            failed.append(values["a"])
            raise ModelError("too far")
        return np.array([values["a"] ** 2 - 4.0, 0.0])

    assert fit((Parameter("a", 1.2),), of).values["a"] == pytest.approx(2.0, abs=1e-4)
    assert failed


def law(values: dict[str, float]) -> np.ndarray:
    """Stiffness k_b over the angle of a robot that the values describe."""
    link = {"length": 0.1, "radius": 0.01, "mass": 0.05, "k_e": [400.0, 0.0, 0.0]}
    robot = robot_from_dict({"links": [{**link, "k_b": [values["a4"], values["a5"], 2.0]}]})
    a4, a5, a6 = robot.links[0].k_b
    return a4 + a5 * (np.tanh(a6 * np.linspace(0.0, 2.0, 20)) ** 2 - 1.0)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("start", [(0.1, 0.01), (0.03, 0.029)])
def test_candidates_that_no_robot_file_allows_are_hopeless_and_not_fatal(
    start: tuple[float, float], loss: Loss
) -> None:
    """Of little stiffness at rest: on the way the search and its differences leave a4 > a5."""
    true = {"a4": 0.02, "a5": 0.0195}
    refused = []

    def of(values: dict[str, float]) -> np.ndarray:
        try:
            return (law(values) - law(true)) / 1e-3
        except ConfigError:
            refused.append(values)
            raise

    a4, a5 = start
    found = fit((Parameter("a4", a4, 1e-4, 1.0), Parameter("a5", a5, -1.0, 1.0)), of, loss, 100)
    assert refused
    assert all(values["a4"] <= values["a5"] for values in refused)
    assert found.values == pytest.approx(true, rel=1e-3)


def test_the_start_of_a_fit_is_no_candidate_but_must_be_right() -> None:
    assert residuals_or_none(law, {"a4": 0.01, "a5": 0.02}) is None
    assert residuals_or_none(law, {"a4": 0.02, "a5": 0.01}) is not None
    with fails(ConfigError, key="links[0].k_b"):
        fit((Parameter("a4", 0.01), Parameter("a5", 0.02)), law)


@pytest.mark.parametrize("loss", LOSSES)
def test_losses_and_their_slopes_are_those_of_scipy(loss: Loss) -> None:
    f = np.array([-3.0, 0.2, 1.5])
    found = least_squares(lambda x: f + x, [0.0, 0.0, 0.0], loss=loss, max_nfev=1)
    rho, slope, _ = LOSSES[loss]
    assert 0.5 * rho(f**2).sum() == pytest.approx(found.cost)
    assert slope(f**2) * f == pytest.approx(found.grad)


@pytest.mark.parametrize("edge", [1.0, 1.0 + 5e-5])
def test_no_derivative_is_taken_across_the_edge(edge: float) -> None:
    """The start lies at the edge of the candidates; the minimum inside, along both parameters."""

    def of(values: dict[str, float]) -> np.ndarray:
        if values["a"] > edge:
            return np.array([np.inf, 0.0])
        return np.array([values["a"] - 0.7, values["b"] - values["a"]])

    found = fit((Parameter("a", 1.0), Parameter("b", 1.0)), of, max_iterations=10)
    assert found.values == pytest.approx({"a": 0.7, "b": 0.7}, abs=1e-6)


def test_bad_calls_are_refused() -> None:
    with fails(ModelError, key="start"):
        fit((Parameter("a", 1.0),), lambda _: np.array([np.nan]))
    for bad in ((), (Parameter("a", 0.0),), (Parameter("a", 2.0, upper=1.0),), (Parameter("a", 1.0),) * 2):
        with pytest.raises(ValueError, match="parameter"):
            fit(bad, lambda _: np.zeros(1))
