"""From the drawing of a part to a robot: finite elements, then a link that moves alike. Needs no ROS.

python examples/part_to_robot.py [PART.yaml]     # as soro fem run, soro identify-fem: docs/parts.md
"""

import sys

from soro_core import SoftArm, equilibrium
from soro_core.config import with_changes
from soro_design.parts.file import load_part
from soro_design.parts.specimen import make_specimen
from soro_design.parts.sweeps import backbone, follow
from soro_design.robot_of_part.snapshots import snapshots
from soro_design.robot_of_part.stages import identify

part = load_part(sys.argv[1] if len(sys.argv) > 1 else "silicone_rod_three_chambers")
if len(sys.argv) == 1:  # coarse, so that it takes seconds; the file as it is takes minutes
    coarse = with_changes(part.geometry, around=2, across=1, along=5)
    sweeps = tuple(with_changes(sweep, states=2) for sweep in part.sweeps[:-2])
    part = with_changes(part, geometry=coarse, sweeps=sweeps)
specimen = make_specimen(part)
states = []
for sweep in part.sweeps:
    done = follow(specimen, sweep, lambda state: None)
    states += [backbone(specimen, sweep, state) for state in done.states]
    print(f"{sweep.name}: {len(done.states)} states")
found = identify(part, specimen, snapshots(specimen.z, states, part.name), "rod")
print(found.robot)
for name, value in found.values.items():
    print(f"{name}: {value:.4g}")
worst = max(error.share for error in found.held_out)
print(f"largest error of a tip that the fit did not see: {100.0 * worst:.1f} % of the length")
arm = SoftArm(found.robot)
tip_mm = 1e3 * arm.pose(equilibrium(arm, [20e3, 0.0, 0.0]), arm.length)[:3, 3]
print(f"tip under 20 kPa in one chamber: {tip_mm.round(1)} mm")
