"""A wrist exoskeleton: how much of the hand's torque is left for the wearer, for hands of unknown weight."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.options import Options
from benchmarks.report import figure, table
from soro_core import SoftArm, load_robot
from soro_core.bodies import Attachment, BodyWorld, BoxShape, Hinge, RigidBody, WorldStepper
from soro_core.bodies.counterbalance import Counterbalance, CounterbalanceState, LimbMoments, limb_moments
from soro_core.bodies.stepper import WorldState
from soro_core.errors import ModelError
from soro_core.robot import Robot

TITLE = "Wrist exoskeleton"
WRIST = Hinge(point=(0.0, 0.0, 0.0), axis=(0.0, 1.0, 0.0), limits_rad=(-0.9, 0.9), damping=5e-3)
MASSES_KG, CENTRE_M = (0.1, 0.3, 0.4, 0.5, 0.8), 0.09
# The wearer: relaxed for 3 s, then 30 degrees to and fro at 0.5 Hz, as a stiff arm would; judged from 5 s on.
RELAXED_S, BEGIN_S, END_S = 3.0, 5.0, 11.0
SWING_RAD, RATE_HZ, WEARER = math.radians(30.0), 0.5, (8.0, 0.4)
TICK_S, STEP_S, LAG_S, ENCODER_RAD = 5e-3, 2.5e-3, 0.05, 1e-3
# What differs from the model: name, factors on stiffness and gain of the true muscle.
TRUTHS = (
    ("as its file", 1.0, 1.0),
    ("gain 0.8", 1.0, 0.8),
    ("stiffness 1.5", 1.5, 1.0),
    ("stiffness 3", 3.0, 1.0),
)


def run(options: Options) -> str:
    """Measure and write."""
    robot = load_robot("wrist_muscle")
    moments = limb_moments(SoftArm(robot), WRIST, np.linspace(-0.8, 0.8, 33))
    rows = []
    alone = {mass: wearers_torque(mass, None, moments)[0] for mass in MASSES_KG}
    for name, stiffness, gain in TRUTHS[: 1 if options.quick else None]:
        true = robot.scaled(stiffness=stiffness, gain=gain)
        for mass, without in alone.items():
            actual = 9.81 * mass * CENTRE_M
            try:
                with_arm, weight = wearers_torque(mass, true, moments)
            except ModelError as error:
                known = (figure(1e3 * mass), "-", figure(1e3 * actual), figure(1e3 * without))
                rows.append((name, *known, "-", str(error).partition(": ")[2].partition(";")[0]))
                continue
            values = (1e3 * mass, -1e3 * weight, 1e3 * actual, 1e3 * without, 1e3 * with_arm)
            rows.append((name, *map(figure, values), figure(100.0 * with_arm / without)))
    heads = (
        "muscle",
        "hand, g",
        "moment of the weight by the model, mN m",
        "true one",
        "wearer alone, mN m",
        "with muscle",
        "left, %",
    )
    text = (
        "A hand hinged at the wrist, on a braided muscle; weighed for 3 s, then moved by 30 degrees at "
        "0.5 Hz. Torques of the wearer, RMS over 6 s; to reach: 15 % left of hands of 300 to 500 g. Lag of "
        "the valve 50 ms, noise of the encoder 1 mrad."
    )
    return f"{text}\n\n{table(heads, rows)}"


def wearers_torque(mass: float, robot: Robot | None, moments: LimbMoments) -> tuple[float, float]:
    """Return the torque of the wearer [N m RMS], alone where there is no robot, and the learned weight."""
    hand = RigidBody(
        shape=BoxShape(size=(2.0 * CENTRE_M, 0.08, 0.03)),
        mass=mass,
        position=(CENTRE_M, 0.0, 0.0),
        hinge=WRIST,
        attached=None if robot is None else Attachment(),
    )
    world = BodyWorld({"hand": hand}, {} if robot is None else {"muscle": SoftArm(robot)})
    stepper = WorldStepper(world, STEP_S)
    law, learned = Counterbalance(moments, (0.0, 3e5)), CounterbalanceState()
    noise = np.random.default_rng(0)
    state, pressure, torques = stepper.initial_state(), 0.0, []
    for k in range(round(END_S / TICK_S)):
        t = k * TICK_S
        angle, rate = state.angle[0]
        setpoint = 0.0
        if robot is not None:
            measured = angle + ENCODER_RAD * noise.standard_normal()
            learned, setpoint = law.step(learned, measured, rate, pressure, TICK_S)
        before, pressure = pressure, pressure + (setpoint - pressure) * (1.0 - math.exp(-TICK_S / LAG_S))
        # Without a muscle the wearer holds the hand from the begin: relaxed, it would fall.
        torque = 0.0 if robot is not None and t < RELAXED_S else wearer(t - RELAXED_S, angle, rate)
        pressures = {} if robot is None else {"muscle": [[before], [pressure]]}
        result = stepper.step(state, pressures, TICK_S, t, {"hand": [0.0, torque, 0.0, 0.0, 0.0, 0.0]})
        if not result.status.ok:
            raise RuntimeError(str(result.status))
        state = WorldState.last_of(result)
        torques += [torque] if t >= BEGIN_S else []
    return float(np.sqrt(np.mean(np.square(torques)))), learned.weight


def wearer(t: float, angle: float, rate: float) -> float:
    """Torque of a wearer who moves the hand, begun smoothly within 2 s [N m]."""
    part = min(max(0.5 * t, 0.0), 1.0)
    size, phase = SWING_RAD * part * part * (3.0 - 2.0 * part), 2.0 * math.pi * RATE_HZ * t
    wanted, faster = size * math.sin(phase), size * 2.0 * math.pi * RATE_HZ * math.cos(phase)
    return WEARER[0] * (wanted - angle) + WEARER[1] * (faster - rate)
