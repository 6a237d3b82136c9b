"""Robot, platform and scene file of a new arm, from a few options.

Every number of the files has its unit and where it comes from: given, estimated, or a guess.
"""

from soro_lab.scaffold.arm import ArmSetting, Geometry, NewArm, NewLink, new_arm
from soro_lab.scaffold.files import write_arm, write_setting
from soro_lab.scaffold.options import ScaffoldOptions
from soro_lab.scaffold.quantity import Noted

__all__ = [
    "ArmSetting",
    "Geometry",
    "NewArm",
    "NewLink",
    "Noted",
    "ScaffoldOptions",
    "new_arm",
    "write_arm",
    "write_setting",
]
