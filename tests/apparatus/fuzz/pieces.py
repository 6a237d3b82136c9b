"""What a fuzzer sends: valid traffic with damage, and noise; and what has become of it."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias


@dataclass
class Counted:
    """What has become of the pieces that were sent.

    Attributes
    ----------
    good, bad : int
        Taken for a message; refused and counted by who got it.
    untold : int
        Pieces of which the protocol does not say which: not addressed to anybody, or damage without a trace.
    """

    sent: int = 0
    good: int = 0
    bad: int = 0
    untold: int = 0

    @property
    def missing(self) -> int:
        """Pieces that were not counted."""
        return self.sent - self.good - self.bad - self.untold


def damaged(rng: random.Random, messages: Sequence[bytes], longest_noise: int = 40) -> bytes:
    """A valid message, mostly with some bytes changed, or noise."""
    chance = rng.random()
    if chance < 0.25:
        return rng.randbytes(rng.randrange(longest_noise))
    piece = bytearray(rng.choice(messages))
    if chance < 0.45:
        return bytes(piece)
    for _ in range(rng.randrange(1, 4)):
        _damage(rng, piece, messages)
    return bytes(piece)


def _damage(rng: random.Random, piece: bytearray, messages: Sequence[bytes]) -> None:
    place = rng.randrange(len(piece) + 1)
    kind = rng.randrange(6)
    if kind == 0:
        piece.insert(place, rng.randrange(256))
    elif kind == 1:
        del piece[place:]
    elif kind == 2:
        piece += rng.choice(messages)
    elif kind == 3:
        piece[place:place] = piece[: rng.randrange(8)]
    elif place < len(piece):
        if kind == 4:
            del piece[place]
        else:
            piece[place] ^= 1 << rng.randrange(8)


# Takes a number of pieces and a seed; raises where something breaks.
Target: TypeAlias = Callable[[int, int], Counted]
