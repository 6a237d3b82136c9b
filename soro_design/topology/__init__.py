"""Topology optimisation of soft parts that air under pressure drives (docs/design.md).

The forms are those of the literature, but for the following.

- The pressure load of a soft part is -int p J dV of what is not solid, not the gradient of (T5): with p
  fixed to the material the load follows the walls, its stiffness is symmetric, and void of one pressure is
  free of force. The price: an edge of the grid at the inlet has to be held along its normal. The thesis
  [C22] lets void elements expand, which is a dilation and not a pressure: it grows with the volume that
  expands, not with the wall that it meets.
- Spring and motion belong to a patch: at a single node the displacement grows without limit as the grid
  gets finer.
- The gradient takes the slope of (T2) at rho~. SoRoTop (SoRoTop.m, part 6.4, read at 8f1af5a) takes it at
  rho, where it has begun to vanish: for the arch with 20 x 10 elements that leaves 38 % of the slope uphill
  at beta = 8 and 11 % at 16. Ours agrees with differences to 3e-11
  (tests/soro_design/topology/test_design_air.py).
- Walls become tight at a density of .05, not .2: with .2 the air enters grey material that cannot hold it,
  and there is no equilibrium under the rising pressure.

Filter: T. E. Bruns, D. A. Tortorelli, 2001. Projection: F. Wang, B. S. Lazarov, O. Sigmund, 2011. Void: F.
Wang, B. S. Lazarov, O. Sigmund, J. S. Jensen, Interpolation scheme for fictitious domain techniques and
topology optimization of finite strain elastic problems, 2014. Air: P. Kumar, J. S. Frouws, M. Langelaar,
Topology optimization of fluidic pressure-loaded structures and compliant mechanisms using the Darcy method,
2020; P. Kumar, TOPress, 2023, whose arch is the task `arch`; P. Kumar, SoRoTop, 2023. Steps: K. Svanberg,
The method of moving asymptotes, 1987.
"""

from soro_design.topology.check import FinalPart as FinalPart
from soro_design.topology.check import Reanalysis as Reanalysis
from soro_design.topology.check import reanalyse as reanalyse
from soro_design.topology.check import shape as shape
from soro_design.topology.domain import Domain as Domain
from soro_design.topology.domain import make_domain as make_domain
from soro_design.topology.optimise import optimise as optimise
from soro_design.topology.state import IterationRow as IterationRow
from soro_design.topology.state import OptimiserState as OptimiserState
from soro_design.topology.state import load_state as load_state
from soro_design.topology.state import save as save
from soro_design.topology.task import Task as Task
from soro_design.topology.task import load_task as load_task
from soro_design.topology.task import task_from_dict as task_from_dict
