"""Laws: each a part behind one protocol, named in a registry (docs/adding_a_law.md)."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.control.laws.adaptive import Adaptive as Adaptive
    from soro_core.control.laws.composite import Composite as Composite
    from soro_core.control.laws.computed_torque import ComputedTorque as ComputedTorque
    from soro_core.control.laws.guard import LawError as LawError
    from soro_core.control.laws.protocol import ArmBelief as ArmBelief
    from soro_core.control.laws.protocol import Certainty as Certainty
    from soro_core.control.laws.protocol import Law as Law
    from soro_core.control.laws.protocol import LawOptions as LawOptions
    from soro_core.control.laws.protocol import Made as Made
    from soro_core.control.laws.protocol import MeasuredJoint as MeasuredJoint
    from soro_core.control.laws.protocol import Preview as Preview
    from soro_core.control.laws.protocol import Setting as Setting
    from soro_core.control.laws.protocol import Terms as Terms
    from soro_core.control.laws.registry import find_law as find_law
    from soro_core.control.laws.tip_pid import TipPid as TipPid
    from soro_core.control.laws.wrap import Wrap as Wrap

__all__, __getattr__ = lazy(
    __name__,
    {
        ".adaptive": "Adaptive",
        ".composite": "Composite",
        ".computed_torque": "ComputedTorque",
        ".guard": "LawError",
        ".registry": "find_law",
        ".tip_pid": "TipPid",
        ".wrap": "Wrap",
        ".protocol": "ArmBelief Certainty Law LawOptions Made MeasuredJoint Preview Setting Terms",
    },
)
