"""Robot, platform and scene file of a new arm, from a few options.

Every number of the files has its unit and where it comes from: given, estimated, or a guess.
"""

from soro_lab.scaffold.arm import ArmSetting as ArmSetting
from soro_lab.scaffold.arm import Geometry as Geometry
from soro_lab.scaffold.arm import NewArm as NewArm
from soro_lab.scaffold.arm import NewLink as NewLink
from soro_lab.scaffold.arm import new_arm as new_arm
from soro_lab.scaffold.files import write_arm as write_arm
from soro_lab.scaffold.files import write_setting as write_setting
from soro_lab.scaffold.options import ScaffoldOptions as ScaffoldOptions
from soro_lab.scaffold.quantity import Noted as Noted
