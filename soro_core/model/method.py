"""The two methods behind one set of names: which one is compiled follows from the type of the tables."""

from __future__ import annotations

from soro_core._by_type import by_type
from soro_core.model import articulated, exact, mde_dynamics, work
from soro_core.model.tables import MdeTables

# Each follows from the type of the first argument, in Python and in compiled code.
inertia = by_type(MdeTables, mde_dynamics.inertia, exact.inertia)
inertial_force = by_type(MdeTables, mde_dynamics.inertial_force, exact.inertial_force)
external_force = by_type(MdeTables, mde_dynamics.external_force, exact.external_force)
inverse_dynamics = by_type(MdeTables, mde_dynamics.inverse_dynamics, exact.inverse_dynamics)
acceleration = by_type(MdeTables, mde_dynamics.acceleration, exact.acceleration)
factor_system = by_type(MdeTables, mde_dynamics.factor_system, exact.factor_system)
solve_system = by_type(MdeTables, mde_dynamics.solve, articulated.solve)
kinematics = by_type(MdeTables, mde_dynamics.kinematics, exact.kinematics)
energy = by_type(MdeTables, mde_dynamics.energy, exact.energy)
make_work = by_type(MdeTables, work.dense_workspace, work.sparse_workspace)
