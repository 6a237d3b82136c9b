"""The shipped robot tue_three_bellow against the recordings of the real one."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.segment_runs import ReleaseRun, fit_frame, forced_curvature, read_release, release_bend
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Robot, load_robot
from soro_lab.identification import ForcedRun, Parameter, curvature_errors, fit, read_forced

FRAME_UNTIL_S = 12.0


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("tue_three_bellow")


@pytest.fixture(scope="module")
def forced(data: Path) -> ForcedRun:
    return read_forced(data / "tue_three_bellow" / "forced_p123.csv")


@pytest.fixture(scope="module")
def release(data: Path) -> ReleaseRun:
    return read_release(data / "tue_three_bellow" / "release_17deg.csv")


def test_forced_curvatures(robot: Robot, forced: ForcedRun, figure: Callable[[str], None]) -> None:
    """Measured pressures act on the chambers directly; the frame is fitted on the first 12 s only."""
    t, simulated = forced_curvature(SoftArm(robot), forced, dt=4e-3)
    measured = forced.curvature_at(t)
    first = t < FRAME_UNTIL_S
    frame = fit_frame(measured[first], simulated[first])
    rest = curvature_errors(measured[~first], simulated[~first], frame.rotation, frame.offset)
    figure(
        f"simulate, 12-24 s: vector RMS {rest.vector:.3f} 1/m, magnitude RMS {rest.magnitude:.3f} 1/m; "
        f"frame of 0-12 s: {frame.rotation:.4f} rad, ({frame.offset[0]:.3f}, {frame.offset[1]:.3f}) 1/m"
    )
    assert rest.vector <= 0.35
    assert rest.magnitude <= 0.21
    # The file tells the frame that this fit finds.
    assert frame.rotation == pytest.approx(robot.calibration.frame_rotation_rad, abs=0.01)
    assert frame.offset == pytest.approx(robot.calibration.curvature_offset, abs=0.05)


def test_the_start_straight_makes_no_difference(robot: Robot, forced: ForcedRun) -> None:
    """A caller who starts from the straight arm, not from rest under pressure, finds the same errors."""
    from soro_core import simulate

    arm = SoftArm(robot)
    result = simulate(arm, np.zeros(3), np.zeros(3), t_end=23.9, dt=0.01, pressure=forced.pressure_at)
    assert result.status.ok
    measured, first = forced.curvature_at(result.t), result.t < FRAME_UNTIL_S
    frame = fit_frame(measured[first], result.q[first, 1:])
    rest = curvature_errors(measured[~first], result.q[~first, 1:], frame.rotation, frame.offset)
    assert rest.vector <= 0.35
    assert rest.magnitude <= 0.21


def test_release(robot: Robot, release: ReleaseRun, figure: Callable[[str], None]) -> None:
    t, bend = release_bend(SoftArm(robot), release.bend[0], float(release.t[-1]))
    error = np.degrees(bend - np.interp(t, release.t, release.bend))
    rms = float(np.sqrt(np.mean(error**2)))
    frequency, damping = oscillation(t, bend)
    measured = oscillation(release.t, release.bend)
    figure(
        f"17 degree release: RMS {rms:.3f} deg; {frequency:.2f} Hz (measured {measured[0]:.2f}), "
        f"damping ratio {damping:.3f} (measured {measured[1]:.3f})"
    )
    assert rms <= 0.40
    assert frequency == pytest.approx(7.9, rel=0.05)
    assert damping == pytest.approx(0.19, abs=0.04)


def oscillation(t: np.ndarray, bend: np.ndarray) -> tuple[float, float]:
    """Frequency [Hz] and damping ratio from the first five turning points after the start."""
    slope = np.diff(bend)
    turns = np.flatnonzero(slope[:-1] * slope[1:] < 0)[:5] + 1
    half_period = np.diff(t[turns]).mean()
    swings = np.abs(np.diff(bend[turns]))
    decrement = np.log(swings[0] / swings[-1]) / (len(swings) - 1)
    return 0.5 / half_period, decrement / np.hypot(decrement, np.pi)


@pytest.mark.parametrize("payload_kg", [0.0, 0.02])
def test_ten_per_metre_is_in_reach_all_round(robot: Robot, payload_kg: float) -> None:
    """The pressures 0-90 kPa hold |kappa| = 10 1/m in every direction, with a payload too."""
    arm = SoftArm(robot.replace(tip_mass=payload_kg))
    low, high = robot.pressure_range_pa
    for angle in np.radians(np.arange(0, 360, 15)):
        curvature = 10 * np.array([np.cos(angle), np.sin(angle)])
        held = [holding_pressure(arm, np.array([eps, *curvature])) for eps in np.linspace(-0.05, 0.15, 201)]
        inside = [p for p in held if p.min() >= low and p.max() <= high]
        assert inside, f"no pressures hold {np.degrees(angle):.0f} deg"


def holding_pressure(arm: SoftArm, q: np.ndarray) -> np.ndarray:
    return np.linalg.solve(arm.actuation_matrix(q), arm.gravity_force(q) + arm.elastic_force(q))


def test_elongation_is_plausible(robot: Robot) -> None:
    """Curvatures do not show it: the file claims a few millimetres at 30-90 kPa in all chambers."""
    for pressure, low, high in ((30e3, 1e-3, 6e-3), (90e3, 3e-3, 12e-3)):
        longer = equilibrium(SoftArm(robot), np.full(3, pressure))[0] * robot.links[0].length
        assert low < longer < high


@pytest.mark.slow
def test_an_outlier_in_the_recording_spoils_no_fit(robot: Robot, forced: ForcedRun, data: Path) -> None:
    """The same fit with the start of the run as recorded, spike included, and with the spike removed."""
    spike = read_forced(data / "tue_three_bellow" / "forced_p123_spike.csv")
    start = forced.window(0.0, 6.0)
    spoiled = start.curvature.copy()
    spoiled[: len(spike.t)] = spike.curvature
    assert np.abs(spoiled - start.curvature).max() > 5.0

    link = robot.links[0].model_dump(exclude_unset=True)

    def identified(curvature: np.ndarray, loss: str) -> np.ndarray:
        run = ForcedRun(start.t, start.pressure, curvature)

        def residuals(values: dict[str, float]) -> np.ndarray:
            chambers = [{**c, "alpha_kappa": c["alpha_kappa"] * values["gain"]} for c in link["chambers"]]
            t, q = forced_curvature(SoftArm(robot.replace(links=[{**link, "chambers": chambers}])), run)
            c, s = np.cos(values["rotation"]), np.sin(values["rotation"])
            shown = q @ np.array([[c, s], [-s, c]]) + [values["x"], values["y"]]
            return ((shown - run.curvature_at(t)) / 0.1).ravel()

        unknown = (
            Parameter("gain", 1.0),
            Parameter("rotation", -0.5),
            Parameter("x", 0.3, scale=1.0),
            Parameter("y", 0.3, scale=1.0),
        )
        return np.array(list(fit(unknown, residuals, loss=loss).values.values()))

    clean = identified(start.curvature, "soft_l1")
    np.testing.assert_allclose(identified(spoiled, "soft_l1"), clean, atol=0.05)
    assert np.abs(identified(spoiled, "linear") - identified(start.curvature, "linear")).max() > 0.1
