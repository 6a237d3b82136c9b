"""The model of one robot: methods that check their arguments and call kernels."""

from __future__ import annotations

from functools import lru_cache
from numbers import Integral
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.errors import ModelError, short
from soro_core.model import entries
from soro_core.model.arm_base import DEFAULT_STEPS, default_nodes
from soro_core.model.build import build_tables, find_site
from soro_core.model.checks import dimensions, finite, flat_wrench, number, refuse_unsupported, shaped
from soro_core.model.forces.external_forces import ExternalForces
from soro_core.model.forces.motion import MotionForces
from soro_core.model.forward import ForwardDynamics
from soro_core.model.tables import Site
from soro_core.robot import Robot
from soro_core.robot.description import END_TOLERANCE


class SoftArm(ForwardDynamics):
    """Dynamics of one robot: M qdd + C qd + G + dU_e/dq + R qd + internal = H p + J_tip' w.

    docs/model.md derives it, (11), and says what the literature calls it: PCS, PCC or GVS.

    Parameters
    ----------
    robot : Robot
    method : {"exact", "mde"}
        Closed forms and Magnus steps with Gauss-Radau quadrature, or the matrix differential equation of the
        literature with an explicit second-order Runge-Kutta rule, docs/model.md (15).
    nodes : int, optional
        Quadrature nodes a link, and Magnus steps where its strain varies; of `exact` only, at least 2,
        default `default_nodes`.
    steps : int, optional
        Steps a link; of `mde` only, default 20.

    Raises
    ------
    ModelError
        If an argument is not allowed; and by the methods for a wrong shape, a value that is not finite, or an
        elongation of -1 or less.
    """

    def __init__(
        self,
        robot: Robot,
        method: Literal["exact", "mde"] = "exact",
        nodes: int | None = None,
        steps: int | None = None,
    ) -> None:
        refuse_unsupported(robot, method, nodes, steps)
        self.robot = robot
        self.method = method
        self.nodes = default_nodes(robot) if nodes is None else int(nodes)
        self.steps = DEFAULT_STEPS if steps is None else int(steps)
        self.tables = build_tables(robot, method, self.nodes, self.steps)
        self._box = entries.make_box(self.tables)
        self._site = lru_cache(maxsize=64)(lambda s: find_site(self.robot, self.tables, s))
        self.n_q = robot.n_q
        self.n_u = robot.n_u
        self.n_internal = len(self.tables.internal_kind)
        self.length = float(self.tables.length.sum())
        self._no_wrench = flat_wrench(robot, None)
        self._no_internal = np.zeros(self.n_internal)
        self._no_velocity = np.zeros(self.n_q)

    def __reduce__(self) -> tuple[type[SoftArm], tuple[object, ...]]:
        """Pickle what the arm is built from: its tables are in memory of compiled code."""
        exact = self.method == "exact"
        return type(self), (
            self.robot,
            self.method,
            self.nodes if exact else None,
            None if exact else self.steps,
        )

    def __repr__(self) -> str:
        of = f"{self.nodes} nodes" if self.method == "exact" else f"{self.steps} steps"
        return f"SoftArm({self.robot!r}, {self.method}, {of} a link)"

    def inertia_matrix(self, q: ArrayLike) -> Array:
        """Inertia matrix M (n_q, n_q), symmetric positive definite, docs/model.md (13)."""
        q, _ = self._state(q)
        M = np.empty((self.n_q, self.n_q))
        entries.inertia_matrix(self._box, q, M)
        return M

    def coriolis_matrix(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Coriolis matrix C (n_q, n_q) such that Mdot - 2C is skew-symmetric, docs/model.md (13)."""
        q, qd = self._state(q, qd)
        unit = np.eye(self.n_q)
        return np.ascontiguousarray(self._inertial(q, qd, unit, np.zeros_like(unit), np.zeros(3)).T)

    def coriolis_force(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """C qd (n_q,)."""
        q, qd = self._state(q, qd)
        return self._inverse(q, qd, qd, self._no_velocity, np.zeros(3))

    def gravity_force(self, q: ArrayLike) -> Array:
        """dU_g/dq (n_q,), on the left-hand side, docs/model.md (13)."""
        q, rest = self._state(q)
        return self._inverse(q, rest, rest, rest, self.tables.gravity)

    def inverse_dynamics(self, q: ArrayLike, qd: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """M(q) a + C(q, qd) v + G(q), (n_q,): the inertial part of a passivity-based law.

        Parameters
        ----------
        q, qd : (n_q,)
            Coordinates and velocities.
        v, a : (n_q,)
            Reference velocities and accelerations.
        """
        q, qd = self._state(q, qd)
        return self._inverse(
            q, qd, self._vector(v, self.n_q, "v"), self._vector(a, self.n_q, "a"), self.tables.gravity
        )

    def elastic_force(self, q: ArrayLike) -> Array:
        """dU_e/dq (n_q,)."""
        q, _ = self._state(q)
        force = np.empty(self.n_q)
        entries.elastic_force(self._box, q, force)
        return force

    def stiffness_matrix(self, q: ArrayLike) -> Array:
        """d2U_e/dq2 (n_q, n_q)."""
        q, _ = self._state(q)
        K = np.zeros_like(self.tables.stiffness)
        entries.add_stiffness(self._box, q, K)
        return self._assemble(K)

    def damping_force(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """R qd (n_q,); creep and hysteresis are in `internal_force`."""
        q, qd = self._state(q, qd)
        force = np.empty(self.n_q)
        entries.damping_force(self._box, qd, force)
        return force

    def damping_matrix(self) -> Array:
        """R (n_q, n_q)."""
        return self._assemble(self.tables.damping)

    def actuation_matrix(self, q: ArrayLike | None = None) -> Array:
        """H (n_q, n_u), generalised force per acting Pa, of tendons per N; default at q = 0.

        Constant without area_slope, and where a straight tendon meets neither torsion nor shear.
        """
        q, _ = self._state(self._no_velocity if q is None else q)
        found: Array = self._actuation(q.reshape(1, -1))[0]
        return found

    def actuation_matrices(self, q: ArrayLike) -> Array:
        """H (m, n_q, n_u) as `actuation_matrix` gives each, of finite coordinates (m, n_q)."""
        rows = shaped(q, (len(q), self.n_q), "q", self.robot.name)  # type: ignore[arg-type]
        finite(rows.ravel(), "q")
        return self._actuation(rows)

    def _actuation(self, rows: Array) -> Array:
        gradients = np.empty((len(rows), self.n_u, self.n_q))
        entries.actuation(self._box, rows, gradients)
        return np.ascontiguousarray(gradients.transpose(0, 2, 1))

    def pressure_force(self, q: ArrayLike, p: ArrayLike) -> Array:
        """Generalised force (n_q,) of p (n_u,), as in `forward_dynamics`: H times the effective pressures."""
        return np.asarray(self.actuation_matrix(q) @ self.acting_pressure(p))

    def displaced_volume(self, q: ArrayLike) -> Array:
        """Volumes of chambers beyond those at q = 0 [m^3], then how much shorter each tendon is [m], (n_u,).

        Its gradient is `actuation_matrix`, so that p times its change is the work of constant inputs p [J].
        """
        q, _ = self._state(q)
        volume = np.empty(self.n_u)
        entries.displaced_volumes(self._box, q, volume)
        return volume

    def internal_force(self, q: ArrayLike, internal_state: ArrayLike) -> Array:
        """Force on the left-hand side (n_q,) of the internal states (n_internal,), creep and hysteresis."""
        self._state(q)
        force = np.zeros(self.n_q)
        z = self._vector(internal_state, self.n_internal, "internal")
        entries.add_internal_force(self._box, z, force)
        return force

    def internal_rate(self, q: ArrayLike, qd: ArrayLike, internal_state: ArrayLike) -> Array:
        """Rate of the internal states (n_internal,), docs/model.md (21), (22).

        Parameters
        ----------
        q, qd : (n_q,)
            Coordinates and velocities.
        internal_state : (n_internal,)
            All creep branches link by link, then all hysteresis elements, in units of their coordinates.
        """
        _, qd = self._state(q, qd)
        rate = np.empty(self.n_internal)
        z = self._vector(internal_state, self.n_internal, "internal")
        entries.internal_rate(self._box, qd, z, rate)
        return rate

    def internal_midpoint(self, q: ArrayLike, qd: ArrayLike, internal_state: ArrayLike, dt: float) -> Array:
        """Internal states (n_internal,) after `dt` [s] at held rates, by the midpoint rule.

        A state that would not be finite keeps its value. An arm without any computes nothing.

        Parameters
        ----------
        q, qd : (n_q,)
            Coordinates and velocities.
        internal_state : (n_internal,)
            As in `internal_rate`.
        dt : float
            Time step [s].
        """
        if self.n_internal == 0:
            return self._no_internal
        _, qd = self._state(q, qd)
        z = self._vector(internal_state, self.n_internal, "internal")
        new = np.empty(self.n_internal)
        entries.internal_midpoint(self._box, qd, z, dt, np.empty(self.n_internal), new)
        return new

    def pose(self, q: ArrayLike, s: float) -> Array:
        """Pose (4, 4) in the world at `s` metres of undeformed length from the base."""
        q, _ = self._state(q)
        poses = np.empty((1, 4, 4))
        entries.sections(self._box, self._place(s), q.reshape(1, -1), poses)
        found: Array = poses[0]
        return found

    def poses(self, q: ArrayLike, s: ArrayLike) -> Array:
        """Poses (4, 4), as `pose` gives each, of many coordinates, at many places, or both.

        Parameters
        ----------
        q : (n_q,) or (m, n_q)
            Coordinates.
        s : float or (k,)
            Undeformed lengths from the base [m].

        Returns
        -------
        Array of shape (m, 4, 4), (k, 4, 4) or (m, k, 4, 4)
        """
        one, places = dimensions(q) != 2, _places(s)
        m = 1 if one else len(q)  # type: ignore[arg-type]
        rows = shaped(q, (self.n_q,) if one else (m, self.n_q), "q", self.robot.name).reshape(m, self.n_q)
        finite(rows.ravel(), "q")
        found = np.empty((m, len(places), 4, 4))
        of_place = np.empty((m, 4, 4))
        for k, place in enumerate(places):
            entries.sections(self._box, self._place(float(place)), rows, of_place)
            found[:, k] = of_place
        if dimensions(s) == 0:
            found = found[:, 0]
        return found[0] if one else found

    def backbone(self, q: ArrayLike, n: int = 50) -> Array:
        """Positions [m] in the world of `n` places at even undeformed lengths, base and tip among them.

        Parameters
        ----------
        q : (n_q,) or (m, n_q)
            Coordinates.
        n : int
            Number of places, 2 or more.

        Returns
        -------
        Array of shape (n, 3) or (m, n, 3)
        """
        if not isinstance(n, Integral) or isinstance(n, bool) or n < 2:
            raise ModelError(f"n = {short(n)}: allowed is a whole number of 2 or more", "n")
        return np.ascontiguousarray(self.poses(q, np.linspace(0.0, self.length, int(n)))[..., :3, 3])

    def jacobian(self, q: ArrayLike, s: float) -> Array:
        """Body Jacobian (6, n_q) at `s`, rows (angular, linear)."""
        return self.pose_and_jacobian(q, s)[1]

    def pose_and_jacobian(self, q: ArrayLike, s: float) -> tuple[Array, Array]:
        """`pose` and `jacobian` at `s`, found together."""
        q, _ = self._state(q)
        T, R, p, J = np.zeros((4, 4)), np.empty((3, 3)), np.empty(3), np.empty((self.n_q, 6))
        entries.pose_and_jacobian(self._box, self._place(s), q, R, p, J)
        T[:3, :3], T[:3, 3], T[3, 3] = R, p, 1.0
        return T, np.ascontiguousarray(J.T)

    def _place(self, s: float) -> Site:
        """Where `s` [m] lies in the tables."""
        place = number(s)
        if not -END_TOLERANCE <= place <= self.length + END_TOLERANCE:
            raise ModelError(f"s = {short(s)} m: allowed is 0 to {self.length!r} m", "s")
        return self._site(min(max(place, 0.0), self.length))

    def external_forces(
        self, q: ArrayLike, qd: ArrayLike | None = None, wrench: ArrayLike | None = None
    ) -> ExternalForces:
        """Forces of wrenches, contact and the held tip.

        Parameters
        ----------
        q : (n_q,)
            Coordinates.
        qd : (n_q,), optional
            Velocities; default at rest.
        wrench : (6,) or (n_wrenches, 6), optional
            Wrenches as in `forward_dynamics`; default none.
        """
        q, qd = self._state(q, qd)
        t = self.tables
        tau, force = np.empty(self.n_q), np.empty((len(t.external.kind), 3))
        w = finite(flat_wrench(self.robot, wrench), "wrench")
        energy = entries.external_forces(self._box, q, qd, w, tau, force)
        base = np.repeat(np.cumsum(t.length) - t.length, np.diff(t.external.first))
        return ExternalForces(tau, base + t.external.place, force, t.external.kind.copy(), energy)

    def energy(self, q: ArrayLike, qd: ArrayLike) -> tuple[float, float, float]:
        """Kinetic, gravitational (zero at the world's origin) and elastic energy [J]."""
        q, qd = self._state(q, qd)
        kinetic, potential = entries.mechanical_energy(self._box, q, qd)
        return kinetic, potential, entries.elastic_energy(self._box, q)

    def mass_regressor(self, q: ArrayLike, qd: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Columns of Y in docs/model.md (37): M a + C(q, qd) v + G per kg of the tip mass and of each link.

        Parameters
        ----------
        q, qd : (n_q,)
            Coordinates and velocities.
        v, a : (n_q,)
            Reference velocities and accelerations.

        Returns
        -------
        Array of shape (n_q, 1 + n_links)
        """
        q, qd = self._state(q, qd)
        n = len(self.robot.links)
        # The last row has none of them: point masses alone, which are in all rows.
        masses, tip_masses = np.eye(2 + n, n, -1), np.eye(1, 2 + n)[0]
        v, a = self._vector(v, self.n_q, "v"), self._vector(a, self.n_q, "a")
        rows = np.empty((2 + n if self.robot.point_masses else 1 + n, self.n_q))
        velocities, accelerations = np.tile(v, (len(rows), 1)), np.tile(a, (len(rows), 1))
        entries.inertial_forces(
            self._box,
            (masses, tip_masses, self.tables.gravity),
            (q, qd, velocities, accelerations),
            rows,
        )
        return np.ascontiguousarray((rows[: 1 + n] - rows[1 + n :].sum(axis=0)).T)

    def tip_mass_force(self, q: ArrayLike, qd: ArrayLike, a: ArrayLike) -> Array:
        """First column of `mass_regressor` at v = qd, for less work: the force (n_q,) per kg at the tip.

        Parameters
        ----------
        q, qd : (n_q,)
            Coordinates and velocities.
        a : (n_q,)
            Accelerations.
        """
        return self.motion_forces(q, qd, a).by_mass

    def motion_forces(self, q: ArrayLike, qd: ArrayLike, a: ArrayLike) -> MotionForces:
        """Return the forces of a motion, found together.

        Parameters
        ----------
        q, qd : (n_q,)
            Coordinates and velocities.
        a : (n_q,)
            Accelerations.
        """
        q, qd = self._state(q, qd)
        a = self._vector(a, self.n_q, "a")
        own, by_mass, gradients = np.empty(self.n_q), np.empty(self.n_q), np.empty((self.n_u, self.n_q))
        entries.motion_forces(self._box, (q, qd, a), own, by_mass, gradients)
        return MotionForces(own, by_mass, np.ascontiguousarray(gradients.T))

    def elastic_regressor(self, q: ArrayLike) -> Array:
        """Columns of Y in docs/model.md (37): dU_e/dq per (a1, a2, a4, a5) of each link, (n_q, 4 n_links).

        They are zero where a material holds.
        """
        q, _ = self._state(q)
        Y = np.empty((self.n_q, 4 * len(self.robot.links)))
        entries.elastic_regressor(self._box, q, Y)
        return Y


def _places(s: ArrayLike) -> Array:
    """Return places (k,), of one length or of several."""
    try:
        places = np.atleast_1d(np.array(s, dtype=np.float64))
    except (TypeError, ValueError, OverflowError):
        places = np.empty((0, 0))
    if places.ndim != 1:
        raise ModelError(f"s: got {short(s)}; allowed is a length [m], or a list of lengths", "s")
    return places
