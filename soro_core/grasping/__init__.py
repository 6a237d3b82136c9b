"""Squeeze an object between fingers without its weight or friction: `Squeeze`, docs/bodies.md."""

from typing import TYPE_CHECKING

from soro_core.extras import lazy

if TYPE_CHECKING:
    from soro_core.grasping.finger import Finger as Finger
    from soro_core.grasping.hand import Hand as Hand
    from soro_core.grasping.settings import HandKeys as HandKeys
    from soro_core.grasping.settings import SqueezeSettings as SqueezeSettings
    from soro_core.grasping.simulate import SqueezeRun as SqueezeRun
    from soro_core.grasping.simulate import SqueezeTrial as SqueezeTrial
    from soro_core.grasping.simulate import simulate_squeeze as simulate_squeeze
    from soro_core.grasping.squeeze import Felt as Felt
    from soro_core.grasping.squeeze import Squeeze as Squeeze
    from soro_core.grasping.squeeze import SqueezeState as SqueezeState

__all__, __getattr__ = lazy(
    __name__,
    {
        ".finger": "Finger",
        ".hand": "Hand",
        ".settings": "HandKeys SqueezeSettings",
        ".simulate": "SqueezeRun SqueezeTrial simulate_squeeze",
        ".squeeze": "Felt Squeeze SqueezeState",
    },
)
