"""What was wrong with the samples of a stream."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class OmittedSamples:
    """Counts of the samples of one stream that were left out.

    Attributes
    ----------
    stream : str
        Name of the stream.
    samples : int
        Samples in the file.
    not_finite : int
        Samples with a value that is missing or not finite.
    not_ok : int
        Samples that the source marks as bad, and quaternions that are no rotations.
    outside : int
        Samples outside the stated range.
    backwards : int
        Samples whose stamp does not lie behind the one before.
    repeated : int
        Samples equal to the bit to the one before, which a logger has repeated.
    frozen : tuple of (float, float)
        First and last time [s] of each stretch in which the sensor gave one reading all the time.
    frozen_samples : int
        Samples in these stretches.
    """

    stream: str
    samples: int
    not_finite: int = 0
    not_ok: int = 0
    outside: int = 0
    backwards: int = 0
    repeated: int = 0
    frozen: tuple[tuple[float, float], ...] = ()
    frozen_samples: int = 0

    @property
    def left_out(self) -> int:
        """Samples left out for any reason."""
        bad = self.not_finite + self.not_ok + self.outside + self.backwards
        return bad + self.repeated + self.frozen_samples

    def __str__(self) -> str:
        named = (
            (self.repeated, "repeated"),
            (self.not_finite, "not finite"),
            (self.not_ok, "marked bad"),
            (self.outside, "outside the range"),
            (self.backwards, "with a stamp that does not rise"),
        )
        parts = [f"{count} {what}" for count, what in named if count]
        parts += [f"frozen from {start:.2f} to {end:.2f} s" for start, end in self.frozen]
        return f"{', '.join(parts)} of {self.samples} samples" if parts else "no faults"
