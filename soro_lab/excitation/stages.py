"""The stages of an excitation: each gives the sections of one question to the arm.

Levels are approached from below and from above, so that play and hysteresis show; each chamber alone gives
its gain, pairs and groups show what chambers do together, fast steps and sweeps make the arm ring.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

import numpy as np

from soro_core.arrays import Array
from soro_lab.excitation.config import ExciteConfig, Stage
from soro_lab.excitation.section import ExcitationSegment, Sweep
from soro_lab.excitation.supply import Supply

# Levels are this power of even ones: an arm bends most at the first pressures.
SPACING = 1.5
# Levels of a pair, parts of the range of its first and its second chamber; both begin and end empty.
PAIR = ((0.5, 0.5), (1.0, 0.5), (1.0, 1.0), (0.5, 0.5))
# Levels of a group.
GROUP = (0.5, 1.0, 0.5)
# Fast steps, parts of the range; the last one is a large fall.
STEPS = (0.25, 0.5, 0.0)
# Level about which a sweep goes, part of the range.
CENTRE = 0.5
REST, RELEASE = "rest", "release"


class Maker:
    """Makes sections one after the other, each from the level of the one before.

    Parameters
    ----------
    supply : Supply
        Range and rates.
    config : ExciteConfig
        Times.
    """

    def __init__(self, supply: Supply, config: ExciteConfig) -> None:
        self.supply, self.config = supply, config
        self._at = np.zeros(len(supply.names))

    def levels(self, parts: dict[int, float]) -> Array:
        """Return set points (n_u,) [Pa gauge] of chambers at parts of the range, the others empty."""
        level = np.zeros(len(self.supply.names))
        for chamber, part in parts.items():
            level[chamber] = part * (self.supply.high_pa if part >= 0.0 else -self.supply.low_pa)
        return level

    def hold(self, stage: str, name: str, level_pa: Array) -> ExcitationSegment:
        """Return a level that lasts until the arm is still.

        Parameters
        ----------
        stage, name : str
            Names of stage and section.
        level_pa : ndarray (n_u,)
            Set points [Pa gauge].
        """
        config = self.config
        ramp_s = max(self._ramp_s(level_pa), config.ramp_s)
        return self._made(
            ExcitationSegment(stage, name, level_pa, ramp_s, config.hold_s, config.shortest_hold_s)
        )

    def last(self, stage: str, name: str, level_pa: Array, time_s: float) -> ExcitationSegment:
        """Return a level that is approached as fast as the limits allow, and lasts for a time.

        Parameters
        ----------
        stage, name : str
            Names of stage and section.
        level_pa : ndarray (n_u,)
            Set points [Pa gauge].
        time_s : float
            Time at the level [s].
        """
        return self._made(ExcitationSegment(stage, name, level_pa, self._ramp_s(level_pa), time_s, time_s))

    def sweep(self, stage: str, name: str, chambers: Sequence[int]) -> ExcitationSegment:
        """Return a sweep of some chambers together about a level where the arm is already.

        Parameters
        ----------
        stage, name : str
            Names of stage and section.
        chambers : sequence of int
            Numbers of the chambers that move.
        """
        supply, config = self.supply, self.config
        amplitude = np.zeros(len(supply.names))
        amplitude[list(chambers)] = config.sweep_part * supply.high_pa
        rate = min(supply.rise_pa_s, supply.fall_pa_s)
        sweep = Sweep(amplitude, supply.sweep_low_hz, supply.sweep_high_hz, rate)
        return self._made(
            ExcitationSegment(stage, name, self._at, 0.0, config.sweep_s, config.sweep_s, sweep)
        )

    def _ramp_s(self, level_pa: Array) -> float:
        """Return the shortest time of a change to a level [s]."""
        change = level_pa - self._at
        times = np.where(change > 0.0, change / self.supply.rise_pa_s, -change / self.supply.fall_pa_s)
        return float(times.max())

    def _made(self, section: ExcitationSegment) -> ExcitationSegment:
        self._at = section.level_pa
        return section


def rest(maker: Maker) -> Iterator[ExcitationSegment]:
    """Yield the arm without pressure, from which its motion is measured."""
    yield maker.last(REST, "empty", maker.levels({}), maker.config.rest_s)


def singles(maker: Maker) -> Iterator[ExcitationSegment]:
    """Yield the levels of one chamber at a time, up, down, and below zero where the range has that."""
    n, supply = maker.config.levels, maker.supply
    up = [((k + 1) / n) ** SPACING for k in range(n)]
    lower = [-1.0] if supply.low_pa < 0.0 else []
    for chamber, name in enumerate(supply.names):
        for way, parts in (("up", up), ("down", [*reversed(up[:-1]), 0.0]), ("below", lower)):
            for part in parts:
                level = maker.levels({chamber: part})
                yield maker.hold("singles", f"{name} {way} {part:.0%}", level)
        if lower:
            yield maker.hold("singles", f"{name} back 0%", maker.levels({}))


def pairs(maker: Maker) -> Iterator[ExcitationSegment]:
    """Yield the levels of each two chambers."""
    names = maker.supply.names
    for one, two in combinations(range(len(names)), 2):
        for k, (a, b) in enumerate((*PAIR, (0.0, 0.0))):
            way = "up" if k < 3 else "down"
            name = f"{names[one]} and {names[two]} {way} {a:.0%} {b:.0%}"
            yield maker.hold("pairs", name, maker.levels({one: a, two: b}))


def together(maker: Maker) -> Iterator[ExcitationSegment]:
    """Yield the levels of all chambers of a link, and of the arm."""
    for chambers, name in groups(maker.supply):
        if len(chambers) < 3:  # a pair, or a single one
            continue
        for k, part in enumerate((*GROUP, 0.0)):
            way = "up" if k < 2 else "down"
            level = maker.levels(dict.fromkeys(chambers, part))
            yield maker.hold("together", f"{name} {way} {part:.0%}", level)


def creep(maker: Maker) -> Iterator[ExcitationSegment]:
    """Yield one chamber of each link at the highest level for long, and empty for as long."""
    for chambers in maker.supply.links:
        name = maker.supply.names[chambers[0]]
        for part in (1.0, 0.0):
            level = maker.levels({chambers[0]: part})
            yield maker.last("creep", f"{name} {part:.0%}", level, maker.config.creep_s)


def steps(maker: Maker) -> Iterator[ExcitationSegment]:
    """Yield fast steps of each chamber and each group, after which the arm rings."""
    for chambers, name in _alone_and_groups(maker.supply):
        for part in STEPS:
            level = maker.levels(dict.fromkeys(chambers, part))
            yield maker.last("steps", f"{name} {part:.0%}", level, maker.config.step_s)


def sweeps(maker: Maker) -> Iterator[ExcitationSegment]:
    """Yield sweeps of each chamber and each group."""
    for chambers, name in _alone_and_groups(maker.supply):
        yield maker.hold("sweeps", f"{name} before", maker.levels(dict.fromkeys(chambers, CENTRE)))
        yield maker.sweep("sweeps", f"{name} sweep", chambers)
        yield maker.hold("sweeps", f"{name} after", maker.levels({}))


def release(maker: Maker) -> Iterator[ExcitationSegment]:
    """Yield the empty arm while a person bends it and lets it go."""
    wait_s = maker.config.release_s
    ask = "bend the arm by hand and let it go; when it is at rest again, press Enter"
    yield ExcitationSegment(RELEASE, "by hand", maker.levels({}), 0.0, wait_s, wait_s, asks=ask)


STAGES: dict[Stage, Callable[[Maker], Iterator[ExcitationSegment]]] = {
    "singles": singles,
    "pairs": pairs,
    "together": together,
    "creep": creep,
    "steps": steps,
    "sweeps": sweeps,
}


def groups(supply: Supply) -> list[tuple[tuple[int, ...], str]]:
    """Return the chambers of each link with several, and of the arm with several links, with a name."""
    of_links = [(chambers, f"link {k}") for k, chambers in enumerate(supply.links) if len(chambers) > 1]
    everything = tuple(range(len(supply.names)))
    return of_links if len(supply.links) == 1 else [*of_links, (everything, "all")]


def _alone_and_groups(supply: Supply) -> list[tuple[tuple[int, ...], str]]:
    return [*(((k,), name) for k, name in enumerate(supply.names)), *groups(supply)]
