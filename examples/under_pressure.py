"""Where an arm comes to rest under pressures, alone and with a weight at its tip. Needs no ROS.

python examples/under_pressure.py
"""

from soro_core import SoftArm, equilibrium, load_robot

arm = SoftArm(load_robot("tue_three_bellow"))
for kpa in (0.0, 10.0, 20.0, 30.0):
    for grams in (0.0, 5.0):
        q = equilibrium(arm, pressure=[1e3 * kpa, 0.0, 0.0], added_tip_mass=1e-3 * grams)
        x, _, z = 1e3 * arm.pose(q, arm.length)[:3, 3]
        print(f"{kpa:2.0f} kPa in chamber 0, {grams:.0f} g at the tip: x {x:6.2f} mm, z {z:5.2f} mm")
