"""A law of your own, docs/adding_a_law.md: statics of the model, and a spring to the reference."""

import numpy as np
from pydantic import Field

from soro_core.control.laws import Law, LawOptions


class SpringOptions(LawOptions):
    """What stands under `law_options`."""

    stiffness: float = Field(0.1, ge=0, le=1, description="of the spring, part of the arm's own")


class Spring(Law[float]):
    """Its state is the time that the law has run [s]."""

    Options = SpringOptions

    def __init__(self, setting, options):
        self.arm, self.stiffness = setting.arm, options.stiffness

    def initial_state(self):
        return 0.0

    def step(self, state, belief, reference, dt):
        q_d = reference.ahead.q
        model = self.arm.gravity_force(q_d) + self.arm.elastic_force(q_d)
        spring = -self.stiffness * np.diag(self.arm.stiffness_matrix(q_d)) * (belief.q - q_d)
        return state + dt, model + spring, {"model": model, "spring": spring}

    def estimates(self, state):
        return {"run_s": state}
