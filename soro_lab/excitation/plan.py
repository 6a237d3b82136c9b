"""The plan of an excitation: its sections in order, fitted into a time."""

from __future__ import annotations

from dataclasses import dataclass

from soro_core.config import with_changes
from soro_core.errors import ConfigError
from soro_lab.excitation.config import ExciteConfig
from soro_lab.excitation.section import ExcitationSegment
from soro_lab.excitation.stages import STAGES, Maker, release, rest
from soro_lab.excitation.supply import Supply

# Keys that `duration_s` scales, and the least factor: shorter levels do not show where the arm rests.
_SCALED = ("hold_s", "creep_s", "step_s", "sweep_s")
LEAST = 0.5


@dataclass(frozen=True)
class ExcitationPlan:
    """Sections of an excitation.

    Attributes
    ----------
    names : tuple of str
        Names of the chambers.
    sections : tuple of ExcitationSegment
        In order; the first one is the arm without pressure.
    """

    names: tuple[str, ...]
    sections: tuple[ExcitationSegment, ...]

    @property
    def longest_s(self) -> float:
        """Longest time of all sections [s]."""
        return sum(section.longest_s for section in self.sections)

    @property
    def still_s(self) -> float:
        """Longest time for which a level asks the arm to be still [s]."""
        return max((one.shortest_s for one in self.sections if not one.lasts), default=0.4)

    def left_s(self, index: int, t: float) -> float:
        """Return the longest time left [s], at a time t [s] since the begin of the section of an index."""
        present = self.sections[index].longest_s - t
        return max(0.0, present) + sum(one.longest_s for one in self.sections[index + 1 :])


def make_plan(supply: Supply, config: ExciteConfig, where: str) -> ExcitationPlan:
    """Return the sections of an excitation.

    Parameters
    ----------
    supply : Supply
        Range and rates of the set points.
    config : ExciteConfig
        Stages and times.
    where : str
        File or node of the configuration, for errors.

    Raises
    ------
    ConfigError
        If `duration_s` is too short for the stages.
    """
    plan = _sections(supply, config)
    if config.duration_s == 0.0:
        return plan
    # The times depend on the factor linearly.
    least = _sections(supply, _scaled(config, LEAST)).longest_s
    if config.duration_s < least:
        n, levels, stages = len(supply.names), config.levels, ", ".join(config.stages)
        allowed = f"at least {least:.1f} s for {n} chambers, {levels} levels and stages {stages}"
        raise ConfigError(where, "excite.duration_s", config.duration_s, allowed)
    slope = (plan.longest_s - least) / (1.0 - LEAST)
    factor = LEAST + (config.duration_s - least) / slope
    return _sections(supply, _scaled(config, factor))


def _sections(supply: Supply, config: ExciteConfig) -> ExcitationPlan:
    maker = Maker(supply, config)
    sections = list(rest(maker))
    for _ in range(config.repeat):
        for stage in config.stages:
            sections += STAGES[stage](maker)
    if config.release:
        sections += release(maker)
    return ExcitationPlan(supply.names, tuple(sections))


def _scaled(config: ExciteConfig, factor: float) -> ExciteConfig:
    times = {name: factor * getattr(config, name) for name in _SCALED}
    shortest = min(config.shortest_hold_s, times["hold_s"])
    return with_changes(config, **times, shortest_hold_s=shortest)
