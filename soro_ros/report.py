"""How a run went, in figures and in a table."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from soro_core.config import find_config
from soro_core.robot import load_robot
from soro_core.scene import Scene
from soro_ros import shadow_report
from soro_ros.recording import Recording, Series, read

Array = NDArray[np.float64]

# The windows that are compared: what the arm does while the adaptation learns, and at the end.
WINDOW_S = 5.0
SETTLED_PART_OF_LENGTH = 0.05
# Time [s] that a recording may lack at either end of a window.
LACK_S = 0.2


@dataclass(frozen=True)
class Summary:
    """Figures of a run; NaN where the run was too short for one."""

    duration_s: float
    tip_error_first_rms_m: float
    tip_error_last_rms_m: float
    tip_error_last_max_m: float
    estimator_error_last_rms_m: float
    settling_s: float
    pressure_min_pa: float
    pressure_max_pa: float
    saturated_part: float
    frames_sent: int
    frames_lost: int
    lateness_p50_ms: float
    lateness_p99_ms: float
    overruns: int
    faults: tuple[str, ...]
    shadow: shadow_report.Differences | None = None

    def to_json(self) -> str:
        """The figures as JSON; what is unknown is null."""
        known = {
            k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(self).items()
        }
        return json.dumps(known, indent=2)


def summarise(bag: Path, scene: Scene) -> Summary | None:
    """Return the figures of a recorded run, or None where nothing was under control."""
    recording = _read(bag, scene)
    t, error = tip_error(recording, scene.duration_s)
    if t.size < 2:
        return None
    length = sum(link.length for link in load_robot(find_config(scene.robot, "robots")).links)
    first = window(t, scene.controller.reference.start_s)
    last = window(t, scene.duration_s - WINDOW_S)
    estimated = recording.estimated_tip
    estimator_error = (
        np.linalg.norm(estimated.at(t) - recording.true_tip.at(t), axis=1)
        if estimated.t.size
        else np.full(t.size, np.nan)
    )
    loop = recording.diagnostics.get("regulator", recording.diagnostics.get("twin", {}))
    command = _during(recording.command, scene.duration_s)
    limits = scene.limits
    at_bound = (command <= limits.minimum_pa + 1.0) | (command >= limits.maximum_pa - 1.0)
    reading = _during(recording.reading, scene.duration_s)
    settled = settling_time(t, error, SETTLED_PART_OF_LENGTH * length)
    return Summary(
        duration_s=float(t[-1]),
        tip_error_first_rms_m=_rms(error[first]),
        tip_error_last_rms_m=_rms(error[last]),
        tip_error_last_max_m=float(error[last].max()) if last.any() else float("nan"),
        estimator_error_last_rms_m=_rms(estimator_error[last]),
        settling_s=settled if _is_complete(float(t[-1]), recording.faults, scene) else float("nan"),
        pressure_min_pa=float(reading.min()) if reading.size else float("nan"),
        pressure_max_pa=float(reading.max()) if reading.size else float("nan"),
        saturated_part=float(at_bound.mean()) if at_bound.size else 0.0,
        frames_sent=int(loop.get("frames_sent", 0)),
        frames_lost=int(loop.get("frames_lost", 0)),
        lateness_p50_ms=float(loop.get("lateness_p50_ms", "nan")),
        lateness_p99_ms=float(loop.get("lateness_p99_ms", "nan")),
        overruns=int(loop.get("overruns", 0)),
        faults=recording.faults,
        shadow=shadow_report.summarise(recording.shadow, scene.duration_s),
    )


def _read(bag: Path, scene: Scene) -> Recording:
    """Read a run's bag; nobody knows more of the tip of a real arm than its sensor."""
    recording = read(bag, scene.name)
    return replace(recording, true_tip=recording.measured_tip) if scene.arm == "real" else recording


def tip_error(recording: Recording, duration_s: float) -> tuple[Array, Array]:
    """Times (n,) and distances (n,) [m] between the true tip and the wanted one, while under control."""
    wanted, true = recording.wanted_tip, recording.true_tip
    if wanted.t.size < 2 or true.t.size < 2:
        return np.zeros(0), np.zeros(0)
    inside = (true.t >= 0.0) & (true.t <= min(duration_s, wanted.t[-1]))
    t = true.t[inside]
    return t, np.asarray(np.linalg.norm(true.value[inside] - wanted.at(t), axis=1))


def window(t: Array, begin_s: float) -> NDArray[np.bool_]:
    """Samples of the WINDOW_S from `begin_s` on; none where the times `t` do not reach that far."""
    end_s = begin_s + WINDOW_S
    if t[0] > begin_s + LACK_S or t[-1] < end_s - LACK_S:
        return np.zeros(t.size, dtype=bool)
    return np.asarray((t >= begin_s) & (t <= end_s))


def settling_time(t: Array, error: Array, bound: float) -> float:
    """Time from which the error stays below `bound` [m]; NaN if it does not."""
    above = np.flatnonzero(error >= bound)
    if above.size == 0:
        return float(t[0])
    return float(t[above[-1] + 1]) if above[-1] + 1 < t.size else float("nan")


def _is_complete(lasted_s: float, faults: tuple[str, ...], scene: Scene) -> bool:
    """Whether a run went to its end in order: of what was cut short nobody knows that it stays."""
    return not faults and lasted_s >= scene.duration_s - LACK_S


def table(summary: Summary, scene: Scene) -> Table:
    """The figures as a table for people."""
    real = "real " if scene.arm == "real" else ""
    rows = Table(
        title=f"{scene.name}: {real}{scene.robot} on {scene.platform or 'the twin'}, {scene.mode}",
        show_header=False,
    )
    start = scene.controller.reference.start_s
    adapting = " (while adapting)" if scene.controller.adapt else ""
    for name, value in (
        ("adaptation", "on" if scene.controller.adapt else "off"),
        ("under control", f"{summary.duration_s:.2f} of {scene.duration_s:g} s"),
        (f"tip error RMS, {start:g} to {start + WINDOW_S:g} s{adapting}", _mm(summary.tip_error_first_rms_m)),
        (f"tip error RMS, last {WINDOW_S:g} s", _mm(summary.tip_error_last_rms_m)),
        (f"tip error max, last {WINDOW_S:g} s", _mm(summary.tip_error_last_max_m)),
        (f"estimator's tip error RMS, last {WINDOW_S:g} s", _mm(summary.estimator_error_last_rms_m)),
        (f"settling to {SETTLED_PART_OF_LENGTH:.0%} of the length", _settling(summary, scene)),
        (
            "measured pressures",
            _or_dash(f"{summary.pressure_min_pa / 1e3:.1f} to {summary.pressure_max_pa / 1e3:.1f} kPa"),
        ),
        ("set points at a bound", f"{summary.saturated_part:.1%}"),
        ("frames sent / lost", f"{summary.frames_sent} / {summary.frames_lost}"),
        *_punctuality(summary, scene),
        *shadow_report.rows(summary.shadow),
        *_injected(scene),
        ("trips", "; ".join(summary.faults) or "none"),
    ):
        rows.add_row(name, value)
    return rows


def _injected(scene: Scene) -> list[tuple[str, str]]:
    """Faults that the scene asked for, which may trip the arm or not."""
    told = "; ".join(f"{fault} at {fault.at:g} s" for fault in scene.faults)
    return [("injected faults", told)] if told else []


def _settling(summary: Summary, scene: Scene) -> str:
    """Settling time; none of a run that was vented or interrupted."""
    if not _is_complete(summary.duration_s, summary.faults, scene):
        return "- (not run to its end)"
    return f"{summary.settling_s:.2f} s" if np.isfinite(summary.settling_s) else "not within the run"


def _punctuality(summary: Summary, scene: Scene) -> list[tuple[str, str]]:
    """Lateness and overruns; lockstep has no schedule to be late for."""
    if scene.mode == "lockstep":
        return []
    late = _or_dash(f"{summary.lateness_p50_ms:.2f} / {summary.lateness_p99_ms:.2f} ms")
    return [("loop lateness p50 / p99", late), ("overruns", str(summary.overruns))]


def draw(bag: Path, scene: Scene, file: Path) -> None:
    """Draw the run: tip against reference, error, pressures, parameter estimates."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    recording = _read(bag, scene)
    t, error = tip_error(recording, scene.duration_s)
    kind = "measured" if scene.arm == "real" else "true"
    beside = recording.shadow.t.size > 0
    rows = 3 if beside else 2
    figure, axes = plt.subplots(rows, 2, figsize=(12, 5 * rows), layout="constrained")
    _draw_path(axes[0, 0], recording, scene.duration_s, kind)
    _draw_error(axes[0, 1], t, error, recording, kind)
    _draw_pressures(axes[1, 0], recording, scene)
    _draw_estimates(axes[1, 1], recording)
    if beside:
        shadow_report.draw(axes[2], recording.shadow, scene.shadow.tolerance_m)
    for axis in axes.flat[1:]:
        axis.set_xlabel("time [s]")
        axis.set_xlim(0, scene.duration_s)
        axis.grid(alpha=0.3)
    for axis in axes.flat:
        if axis.get_legend_handles_labels()[0]:  # below, where it lies over no data
            axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize="small")
    adaptation = "on" if scene.controller.adapt else "off"
    what = "real arm" if scene.arm == "real" else f"payload {scene.twin.payload_kg * 1e3:g} g"
    figure.suptitle(f"{scene.name}: {scene.robot}, {what}, adaptation {adaptation}")
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _draw_path(axis: object, recording: Recording, duration_s: float, kind: str) -> None:
    true, wanted = _within(recording.true_tip, duration_s), _within(recording.wanted_tip, duration_s)
    axis.plot(*(wanted.value[:, :2] * 1e3).T, color="0.6", lw=3, label="reference")
    axis.plot(*(true.value[:, :2] * 1e3).T, color="C0", lw=0.8, label=f"{kind} tip")
    late = true.t >= duration_s - WINDOW_S
    if late.any():
        label = f"{kind} tip, last {WINDOW_S:g} s"
        axis.plot(*(true.value[late, :2] * 1e3).T, color="C3", lw=1.4, label=label)
    axis.set(xlabel="x [mm]", ylabel="y [mm]", title="tip path, seen along the base's axis", aspect="equal")
    axis.grid(alpha=0.3)


def _draw_error(axis: object, t: Array, error: Array, recording: Recording, kind: str) -> None:
    axis.plot(t, error * 1e3, color="C0", lw=0.8, label=f"{kind} tip to reference")
    if recording.estimated_tip.t.size:
        off = np.linalg.norm(recording.estimated_tip.at(t) - recording.true_tip.at(t), axis=1)
        axis.plot(t, off * 1e3, color="C2", lw=0.8, label=f"estimated tip to {kind} tip")
    axis.set(ylabel="distance [mm]", title="tip error", ylim=(0, None))


def _draw_pressures(axis: object, recording: Recording, scene: Scene) -> None:
    for k, name in enumerate(recording.reading.names):
        axis.plot(
            recording.reading.t,
            recording.reading.value[:, k] / 1e3,
            color=f"C{k}",
            lw=0.8,
            label=f"{name} measured",
        )
    for k in range(recording.command.value.shape[1]):
        axis.plot(recording.command.t, recording.command.value[:, k] / 1e3, color=f"C{k}", lw=0.5, alpha=0.4)
    for bound in (scene.limits.minimum_pa, scene.limits.maximum_pa):
        axis.axhline(bound / 1e3, color="0.3", ls="--", lw=0.8)
    axis.set(ylabel="gauge pressure [kPa]", title="pressures (pale: set points; dashed: limits)")


def _draw_estimates(axis: object, recording: Recording) -> None:
    series = recording.estimates
    for k, name in enumerate(series.names):
        values = series.value[:, k]
        largest = float(np.max(np.abs(values))) or 1.0
        # What starts from (almost) nothing, as an unknown load does, is shown against its largest value.
        scale, what = (abs(values[0]), "start") if abs(values[0]) > 0.01 * largest else (largest, "largest")
        label = f"{name} / {scale:.3g} ({what}), end {values[-1]:.3g}"
        axis.plot(series.t, values / scale, lw=1.0, label=label)
    axis.set(ylabel="estimate, scaled", title="parameter estimates", ylim=(0, None))


def _within(series: Series, duration_s: float) -> Series:
    inside = (series.t >= 0.0) & (series.t <= duration_s)
    return Series(series.t[inside], series.value[inside], series.names)


def _during(series: Series, duration_s: float) -> Array:
    return _within(series, duration_s).value if series.t.size else series.value


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _or_dash(text: str) -> str:
    return "-" if "nan" in text else text


def _mm(metres: float) -> str:
    return f"{metres * 1e3:.2f} mm" if np.isfinite(metres) else "-"
