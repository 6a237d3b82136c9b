"""The methods `exact` and `mde` under one set of names: the type of the tables selects the one to compile."""

from __future__ import annotations

from soro_core._by_type import select_by_type
from soro_core.model import exact, work
from soro_core.model.links import articulated, mde_dynamics
from soro_core.model.tables import MdeTables

# The type of the first argument selects, in Python and in compiled code.
inertia = select_by_type(MdeTables, mde_dynamics.inertia, exact.inertia)
inertial_force = select_by_type(MdeTables, mde_dynamics.inertial_force, exact.inertial_force)
motion_force = select_by_type(MdeTables, mde_dynamics.motion_force, exact.motion_force)
tip_mass_force = select_by_type(MdeTables, mde_dynamics.tip_mass_force, exact.tip_mass_force)
external_force = select_by_type(MdeTables, mde_dynamics.external_force, exact.external_force)
inverse_dynamics = select_by_type(MdeTables, mde_dynamics.inverse_dynamics, exact.inverse_dynamics)
acceleration = select_by_type(MdeTables, mde_dynamics.acceleration, exact.acceleration)
factor_system = select_by_type(MdeTables, mde_dynamics.factor_system, exact.factor_system)
solve_system = select_by_type(MdeTables, mde_dynamics.solve, articulated.solve)
kinematics = select_by_type(MdeTables, mde_dynamics.kinematics, exact.kinematics)
energy = select_by_type(MdeTables, mde_dynamics.energy, exact.energy)
make_work = select_by_type(MdeTables, work.mde_workspace, work.exact_workspace)
