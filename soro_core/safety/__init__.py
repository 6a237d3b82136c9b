"""The limiter, the watchdogs, the monitors and the latch: the one place that every command passes.

Everything is a pure function of a frozen state. A cycle is `offer` for each command that has come, `slew`,
which gives the set points that the exchange with the regulators sends, and `judge`, which takes the readings
of that exchange; a person asks for `request_vent` and `reset`. Once tripped the state is latched: it answers
zero set points and `vented` until `reset` is called with a zero command. A `Limiter` holds the state for a
loop.
"""

from soro_core.safety.limiter import doubt as doubt
from soro_core.safety.limiter import interpolated as interpolated
from soro_core.safety.limiter import judge as judge
from soro_core.safety.limiter import offer as offer
from soro_core.safety.limiter import request_vent as request_vent
from soro_core.safety.limiter import reset as reset
from soro_core.safety.limiter import slew as slew
from soro_core.safety.limits import HARD_LIMIT_PA as HARD_LIMIT_PA
from soro_core.safety.limits import Limits as Limits
from soro_core.safety.limits import Monitors as Monitors
from soro_core.safety.limits import Rating as Rating
from soro_core.safety.limits import check_rating as check_rating
from soro_core.safety.limits import for_regulators as for_regulators
from soro_core.safety.limits import narrowed as narrowed
from soro_core.safety.limits import rating_of as rating_of
from soro_core.safety.limits import trips_above as trips_above
from soro_core.safety.limits import usable_range as usable_range
from soro_core.safety.monitor_state import MonitorState as MonitorState
from soro_core.safety.names import Names as Names
from soro_core.safety.names import note_message as note_message
from soro_core.safety.state import SafetyState as SafetyState
from soro_core.safety.state import initial_state as initial_state
from soro_core.safety.state import parts_of as parts_of
from soro_core.safety.stateful import ArmLimiter as ArmLimiter
from soro_core.safety.stateful import Limiter as Limiter
from soro_core.safety.stop import StopState as StopState
from soro_core.safety.stop import hear as hear
from soro_core.safety.stop import why_stopped as why_stopped
