"""The scene file of a new arm: the twin, sensors that it may have, automatic gains, a first reference."""

from __future__ import annotations

import math
from typing import Any

from soro_core.adaptation.modes import first_mode
from soro_core.errors import ConfigError
from soro_core.model import SoftArm
from soro_core.robot import Robot
from soro_core.safety import Limits, trips_above
from soro_core.twin.config import SensorConfig, TwinSection
from soro_lab.scaffold.arm import ArmSetting
from soro_lab.scaffold.quantity import Noted, rounded
from soro_lab.scaffold.reference import FirstReference

RATE_HZ = 200.0
# Range of the defaults of the limits [Pa].
_RANGE = 90e3
# Periods of the first bending in one of the circle, at least, and the shortest period [s].
_SLOWER, _PERIOD_S = 6.0, 4.0
_POSE, _IMU = TwinSection().pose, TwinSection().imu
# Pieces of a link of the twin: the first swing is that of the link to 0.3 %. Longer arms need fewer.
_PARTS = 8

_SHOWS = {
    "circle": "its tip follows a circle",
    "set_point": "it moves to a bent shape and holds it",
    "hold": "it holds the shape in which it is found",
}


def scene_tree(
    arm: ArmSetting, robot: Robot, reference: FirstReference, names: tuple[str, str]
) -> dict[str, Any]:
    """Return the scene file as a tree of `Noted` values.

    Parameters
    ----------
    arm : ArmSetting
    robot : Robot
        As its file says.
    reference : FirstReference
        That the arm can follow.
    names : tuple of str
        Files of robot and platform, in the folder of the scene.
    """
    period = _period(robot)
    return {
        "name": Noted(arm.name, "of the topics, /NAME/arm/state, and of the folders of runs"),
        "description": Noted(_SHOWS[reference.kind], "of soro scenes"),
        "robot": Noted(names[0], "beside this file"),
        "platform": Noted(names[1], "beside this file"),
        "mode": Noted(arm.mode, "real_time, or lockstep: deterministic, as fast as possible"),
        "rate_hz": Noted(RATE_HZ, "ticks of the loop a second; default of a scene"),
        "duration_s": Noted(
            rounded(max(20.0, 3.0 * period + 5.0)),
            "s, time under control; at least three periods of the reference",
        ),
        "seed": Noted(1, "of all noise"),
        "limits": _limits(arm),
        "twin": _twin(robot),
        "controller": _controller(arm, reference, period),
    }


def scene_header(arm: ArmSetting, reference: FirstReference, file: str) -> str:
    """Return the comment at the top of the scene file.

    Parameters
    ----------
    arm : ArmSetting
    reference : FirstReference
    file : str
        Name of the scene file.
    """
    return (
        f"{arm.name} on the emulated platform, written by `{arm.command}`: {_SHOWS[reference.kind]}.\n"
        f"  soro run {file}{' --set mode=lockstep' if arm.mode != 'lockstep' else ''}     on the twin\n"
        f"  soro gains {file}                       the automatic gains as numbers"
    )


def _limits(arm: ArmSetting) -> dict[str, Noted]:
    """Return limits for the range of pressures, in the proportions of the defaults."""
    low, high = arm.pressure_range.value
    part, default, trips = high / _RANGE, Limits(), trips_above(high)
    limits = {
        "minimum_pa": Noted(
            min(low, 0.0), "Pa gauge, lowest set point: the range of the arm, and 0, to vent"
        ),
        "maximum_pa": Noted(high, "Pa gauge, highest set point: the range of the arm"),
        "rise_pa_s": Noted(
            rounded(min(default.rise_pa_s * part, 2e6)), "Pa/s, fastest rise; guess: the range in 0.45 s"
        ),
        "fall_pa_s": Noted(
            rounded(min(default.fall_pa_s * part, 2e6)), "Pa/s, fastest fall; guess: twice as fast"
        ),
        "over_pressure_pa": Noted(
            rounded(trips["over_pressure_pa"]),
            "Pa gauge, reading that vents; guess: a ninth above the range",
        ),
        "burst_pressure_pa": Noted(
            rounded(trips["burst_pressure_pa"]),
            "Pa gauge, reading that vents at once; guess: two ninths above the range",
        ),
    }
    notes = {
        "short_circuit_pa": "Pa gauge, reading of a shorted wire; guess: two thirds above the range",
        "model_pa": "Pa, between a reading and the lag of the valve; guess: a part of the range",
    }
    wider = trips.get("monitors", {})
    monitors = {name: Noted(rounded(value), notes[name]) for name, value in wider.items()}
    return {**limits, **({"monitors": monitors} if monitors else {})}  # type: ignore[dict-item]


def _twin(robot: Robot) -> dict[str, Any]:
    parts = Noted(
        _PARTS if len(robot.links) <= 2 else _PARTS // 2,
        "links of the simulated arm for each of the model, so that the two differ",
    )
    try:
        robot.refine(parts.value)
    except ConfigError:
        parts = Noted(
            1, "links of the simulated arm for each of the model: modes from a file are not divided"
        )
    return {
        "refine": parts,
        "payload_kg": Noted(0.0, "kg, load at the tip that the controller does not know and has to learn"),
        "pose": {
            "enabled": Noted(True, "false: none"),
            **_sensor(_POSE, "1 is the tip; [0.5, 1.0]: a second one in the middle"),
            "position_noise_m": Noted(
                _POSE.position_noise_m, "m, deviation of each coordinate; guess: a camera"
            ),
            "rotation_noise_rad": Noted(_POSE.rotation_noise_rad, "rad, deviation; guess: a camera"),
        },
        "imu": {"enabled": Noted(False, "true: an IMU at each place"), **_sensor(_IMU, "1 is the tip")},
    }


def _sensor(sensor: SensorConfig, places: str) -> dict[str, Noted]:
    return {
        "rate_hz": Noted(sensor.rate_hz, "samples a second; guess: that of yours must divide rate_hz"),
        "delay_s": Noted(sensor.delay_s, "s, from sampling to publication; guess"),
        "locations": Noted(sensor.locations, f"places, parts of the length of the arm: {places}"),
    }


def _controller(arm: ArmSetting, reference: FirstReference, period: float) -> dict[str, Any]:
    low, high = arm.pressure_range.value
    preferred = reference.mean_pressure_pa if reference.kind == "circle" else rounded(0.5 * (low + high))
    pressures = {
        "preferred_pa": Noted(preferred, "Pa gauge, where the force leaves a choice; guess: the middle")
    }
    return {
        "law": Noted("composite", "it learns the load; docs/control.md has the others"),
        "adapt": Noted(True, "whether it learns"),
        "gains": Noted("auto", "from the model of the arm and the delay of the platform: docs/gains.md"),
        "pressures": pressures,
        "reference": _reference(reference, period),
    }


def _reference(reference: FirstReference, period: float) -> dict[str, Noted]:
    if reference.kind == "circle":
        return {
            "kind": Noted("circle", "of the tip"),
            "curvature_per_m": Noted(
                reference.curvature_per_m,
                "1/m, of every link; estimated: four fifths of what the range holds all round",
            ),
            "period_s": Noted(period, "s; at least four, and six periods of the first bending"),
            "mean_pressure_pa": Noted(
                reference.mean_pressure_pa,
                "Pa gauge, decides the elongation; guess: the middle of the range, or less for a soft arm",
            ),
        }
    if reference.kind == "set_point":
        return {
            "kind": Noted("set_point", "or hold; a circle needs three chambers a link"),
            "set_point": Noted(
                reference.set_point,
                "elongation [-] and bending [1/m] of each link; estimated: a rest with more of the range "
                "in the chambers towards angle 0 than in the others",
            ),
        }
    return {"kind": Noted("hold", "where it is found: no other stable rest is found with these numbers")}


def _period(robot: Robot) -> float:
    bend = first_mode(SoftArm(robot), stretch=False)
    slowest = 2.0 * math.pi / bend.rate_per_s if bend is not None else 0.0
    return max(_PERIOD_S, math.ceil(2.0 * _SLOWER * slowest) / 2.0)
