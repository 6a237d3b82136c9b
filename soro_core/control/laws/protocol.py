"""What every law is: (state, belief, reference, dt) -> (state, desired force, terms)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array
from soro_core.config import Strict
from soro_core.control.laws.guard import guard

if TYPE_CHECKING:  # a scene reads a law's keys without its model
    from soro_core.adaptation.external_force import ExternalForce
    from soro_core.adaptation.learned import Learned
    from soro_core.control.config import ControllerConfig
    from soro_core.control.passivity.adaptive import FeedbackGains
    from soro_core.control.pressures.actuation import CompletePressures
    from soro_core.control.reference.trajectory import Point, Reference
    from soro_core.control.reference.underactuation import ActuatedSubspace
    from soro_core.model import SoftArm
    from soro_core.robot.coordinates import StrainFields


# Generalised forces, errors and the like by name, each (n_q,).
Terms: TypeAlias = Mapping[str, Array]


class LawOptions(Strict):
    """The keys of a law under `law_options`; a law with keys derives from it."""


class MeasuredJoint(NamedTuple):
    """Newest measured angle of a joint.

    Attributes
    ----------
    angle_rad : float
        [rad]
    t_s : float
        When it was measured, in the time of control [s].
    age_s : float
        How long ago that is [s].
    """

    angle_rad: float
    t_s: float
    age_s: float


@dataclass(frozen=True)
class ArmBelief:
    """What is known of the arm at one tick.

    Attributes
    ----------
    q, qd : ndarray (n_q,)
        Estimated coordinates and rates.
    covariance : ndarray (2 n_q, 2 n_q) or None
        P, covariance of (q, qd); None where there is none, or the filter has lost the arm.
    positions : bool
        Whether the filter has positions of the arm, not orientations alone.
    creep : ndarray (n_internal,)
        Creep and hysteresis states along the estimated motion.
    pressure_pa : ndarray (n_u,)
        Measured pressures [Pa gauge]; the predicted ones in place of a reading that is not finite.
    saturated : ndarray of bool (n_u,)
        Chambers at a bound at the last tick.
    external : ExternalForce or None
        What pushes on the arm at its tip; None where it is not estimated.
    joint : MeasuredJoint or None
        That of `controller.joint`; None where there is none.
    is_measured : bool
        Whether all of `pressure_pa` is measured.
    """

    q: Array
    qd: Array
    covariance: Array | None
    positions: bool
    creep: Array
    pressure_pa: Array
    saturated: NDArray[np.bool_]
    external: ExternalForce | None = None
    joint: MeasuredJoint | None = None
    is_measured: bool = True


@dataclass(frozen=True)
class Certainty:
    """What a filter says of its estimate.

    Attributes
    ----------
    covariance : ndarray (2 n_q, 2 n_q)
        P, covariance of (q, qd).
    positions : bool
        Whether positions of the arm are measured.
    external : ExternalForce or None
        What pushes on the arm at its tip; None where it is not estimated.
    """

    covariance: Array
    positions: bool
    external: ExternalForce | None = None


@dataclass(frozen=True)
class Preview:
    """The reference.

    Attributes
    ----------
    now, ahead : Point
        The reference now, and when a set point of this tick acts; coordinates that no chamber moves are where
        the law's own force puts them, and the tip is that of the given reference.
    ahead_s : float
        Time until then [s].
    motions : ActuatedSubspace or None
        What the chambers can move about `ahead`; None where that is all.
    later : callable, optional
        Gives the reference a time [s] after now, for `at`.
    """

    now: Point
    ahead: Point
    ahead_s: float
    motions: ActuatedSubspace | None = None
    later: Callable[[float], Point] | None = None

    def at(self, time_s: float) -> Point:
        """Return the reference a time [s] after now, if no other is given meanwhile; `ahead` without `later`.

        Parameters
        ----------
        time_s : float
            0 or more.
        """
        return self.ahead if self.later is None else self.later(time_s)


@dataclass(frozen=True)
class Made:
    """What the allocation makes of a desired force.

    Attributes
    ----------
    desired, force : ndarray (n_q,)
        Desired force, and the nearest one that pressures within their bounds make.
    actuation : ndarray (n_q, n_u)
        H where it was allocated, with the gains of the file.
    acting_pa : ndarray (n_u,)
        Effective pressures [Pa] of the measured ones, beyond dead band and ballooning.
    saturated : bool
        Whether a chamber is at a bound.
    """

    desired: Array
    force: Array
    actuation: Array
    acting_pa: Array
    saturated: bool


@dataclass(frozen=True)
class Setting:
    """What a law is built from.

    Attributes
    ----------
    arm : SoftArm
        Discretised model.
    fields : StrainFields
        Its strains.
    gains : FeedbackGains
        Section `gains` in the coordinates of the arm.
    config : ControllerConfig
        Section `controller` of the scene.
    pressures : CompletePressures
        Bounds, lag and dead time.
    configured : Reference or None
        The configured reference; None to hold the arm where it is.
    limit : ndarray (n_q,)
        Largest absolute strain of a reference.
    pieces : int
        Number of pieces into which each link is discretised.
    """

    arm: SoftArm
    fields: StrainFields
    gains: FeedbackGains
    config: ControllerConfig
    pressures: CompletePressures
    configured: Reference | None
    limit: Array
    pieces: int

    def moved(self, belief: ArmBelief, reference: Preview) -> tuple[Array, Array]:
        """Return coordinates and rates (n_q,) when a set point acts, extrapolated within the limits.

        Where chambers do not move all coordinates, the tip is the estimated one, and the coordinates differ
        from the reference by what the chambers can make: feedback on the rest has no use, and a pose of the
        tip leaves it to chance.

        Parameters
        ----------
        belief : ArmBelief
        reference : Preview
        """
        q = self.fields.within(belief.q + reference.ahead_s * belief.qd, self.limit)
        return (q, belief.qd) if reference.motions is None else reference.motions.within(q, belief.qd)

    def model_force(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return M qdd + C qd + G + f_e + R qd of the model (n_q,), without creep.

        Parameters
        ----------
        q, qd, qdd : ndarray (n_q,)
            Coordinates, rates and accelerations.
        """
        arm = self.arm
        return np.asarray(
            arm.inverse_dynamics(q, qd, qd, qdd) + arm.elastic_force(q) + arm.damping_force(q, qd)
        )


State = TypeVar("State")


class Law(ABC, Generic[State]):
    """A control law. Its `__init__` takes a `Setting` and its options, and raises ConfigError to refuse.

    Allocation of pressures, lag compensation and references are around it and the same for all laws. The
    attribute `setting` is there before `__init__`. Methods of a law from outside soro raise LawError with its
    name, file and line, whatever happens in them.
    """

    Options: ClassVar[type[LawOptions]] = LawOptions
    # Whether it has a learned model for the filter, which then waits for it in lockstep.
    learns: ClassVar[bool] = False
    # Whether it adapts itself to the arm, unless `adapt` is false.
    can_adapt: ClassVar[bool] = False
    # Whether the bias of each regulator is observed and taken off its command.
    observes_regulators: ClassVar[bool] = False
    # Factors on automatic K_p and K_d: of elongation and shear, of bending and torsion.
    feedback_factors: ClassVar[tuple[float, float]] = (1.0, 1.0)
    # Whether it is no part of soro, and checked at each tick.
    is_from_outside: ClassVar[bool] = False

    setting: Setting

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.is_from_outside = not cls.__module__.startswith("soro_core.")
        if cls.is_from_outside:
            guard(cls, METHODS)

    def __new__(cls, setting: Setting | None = None, options: LawOptions | None = None) -> Self:
        law = super().__new__(cls)
        if setting is not None:  # a copy brings its own
            object.__setattr__(law, "setting", setting)
        return law

    def __init__(self, setting: Setting, options: LawOptions) -> None:
        """Keep what the ticks need; `setting` is kept already."""

    @abstractmethod
    def initial_state(self) -> State:
        """Return the state before the first tick."""

    @abstractmethod
    def step(
        self, state: State, belief: ArmBelief, reference: Preview, dt: float
    ) -> tuple[State, Array, Terms]:
        """Return the state after the tick, the desired generalised force (n_q,), and its terms.

        Parameters
        ----------
        state : State
            After the last tick.
        belief : ArmBelief
        reference : Preview
        dt : float
            Time since the last tick [s].
        """

    def reference_force(self, state: State, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the force (n_q,) on the reference, without feedback and creep; the plan of a motion asks.

        Parameters
        ----------
        state : State
            Holds what is learned.
        q, qd, qdd : ndarray (n_q,)
            Coordinates, rates and accelerations of the reference.
        """
        return self.setting.model_force(q, qd, qdd)

    def with_gains(self, state: State, gain: Array, deviation: Array) -> State:
        """Return the state before the first tick, with the gains of the chambers that a probe has measured.

        Parameters
        ----------
        state : State
        gain, deviation : ndarray (n_u,)
            Gains relative to the mean of their link, 0 where they are alike, and their deviations.
        """
        return state

    def heaviest_kg(self) -> float:
        """Return the largest load [kg] at the tip, beside that of the robot file, that the law is for."""
        return 0.0

    def trial_loads_kg(self) -> tuple[float, ...]:
        """Return the loads [kg] with which a trial on the model must keep the arm; none for no trial."""
        return ()

    def actuation(self, state: State, actuation: Array, q: Array) -> Array:
        """Return H as the law believes it.

        Parameters
        ----------
        state : State
        actuation : ndarray (n_q, n_u)
            H of the model at q.
        q : ndarray (n_q,)
            Coordinates.
        """
        return actuation

    def place(self, belief: ArmBelief, reference: Preview) -> Array:
        """Return the coordinates (n_q,) at which H is taken."""
        return reference.ahead.q

    def allocated(self, state: State, made: Made, dt: float) -> State:
        """Return the state once it is known what pressures make of the desired force.

        Parameters
        ----------
        state : State
            From `step` of the same tick.
        made : Made
        dt : float
            Time since the last tick [s].
        """
        return state

    def estimates(self, state: State) -> dict[str, float]:
        """Return what the law has learnt, by name."""
        return {}

    def deviations(self, state: State) -> dict[str, float]:
        """Return the deviations of what is learned, by name."""
        return {}

    def learned(self, state: State) -> Learned | None:
        """Return the learned model for the filter, or None."""
        return None

    def differing(self, state: State) -> str:
        """Return which chambers are known to differ from the robot file, or an empty string."""
        return ""

    def note(self, state: State) -> str:
        """Return what the user must know of this tick, or an empty string."""
        return ""

    def counts(self, state: State) -> dict[str, int]:
        """Return counts since the start, by name, for /diagnostics."""
        return {}


METHODS = frozenset(name for name in vars(Law) if name == "__init__" or not name.startswith("_"))
