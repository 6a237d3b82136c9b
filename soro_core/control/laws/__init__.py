"""Laws: each a part behind one protocol, named in a registry (docs/adding_a_law.md)."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.control.laws.protocol import ArmBelief as ArmBelief
    from soro_core.control.laws.protocol import Certainty as Certainty
    from soro_core.control.laws.protocol import Law as Law
    from soro_core.control.laws.protocol import LawOptions as LawOptions
    from soro_core.control.laws.protocol import Made as Made
    from soro_core.control.laws.protocol import Preview as Preview
    from soro_core.control.laws.protocol import Setting as Setting
    from soro_core.control.laws.protocol import Terms as Terms

__all__, __getattr__ = lazy(
    __name__,
    {
        ".protocol": "ArmBelief Certainty Law LawOptions Made Preview Setting Terms",
    },
)
