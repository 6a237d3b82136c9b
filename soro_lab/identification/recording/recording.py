"""A recording of an arm: pressures in, shape out, each stream with its own stamps on one clock."""

from __future__ import annotations

from dataclasses import dataclass, replace

from soro_core.errors import ConfigError
from soro_lab.identification.recording.streams import (
    Attitude,
    Bend,
    Curvature,
    Imu,
    Marker,
    Plate,
    Series,
    Shape,
    Stream,
)


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


@dataclass(frozen=True)
class Recording:
    """Streams of one run, cleaned.

    Attributes
    ----------
    name : str
        Name of the run.
    chambers : tuple of str
        Names of the n_u chambers, in the robot's order.
    pressure : Series
        Pressures (n, n_u) [Pa gauge].
    command : Series or None
        Set points (n, n_u) [Pa gauge].
    duty : Series or None
        Duty cycles of pumps (n, n_u), 0 to 1.
    plates, markers, curvatures, bends, imus : tuple
        What shows the shape of the arm; none of air alone.
    is_stated : bool
        Whether the pressures are stated levels, because none were measured.
    frame : str
        What positions and quaternions refer to.
    faults : tuple of OmittedSamples
        What was left out of each stream of the file; also that of a window is of the whole file.
    notes : tuple of str
        What the reader has assumed, a line each.
    load_kg : float
        Known mass at the tip during the run, beside that of the robot [kg].
    push_n : tuple of float
        Known force on the tip during the run, in the world [N].
    """

    name: str
    chambers: tuple[str, ...]
    pressure: Series
    command: Series | None = None
    duty: Series | None = None
    plates: tuple[Plate, ...] = ()
    markers: tuple[Marker, ...] = ()
    curvatures: tuple[Curvature, ...] = ()
    bends: tuple[Bend, ...] = ()
    imus: tuple[Imu, ...] = ()
    is_stated: bool = False
    frame: str = "world"
    faults: tuple[OmittedSamples, ...] = ()
    notes: tuple[str, ...] = ()
    load_kg: float = 0.0
    push_n: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Streams that show the shape of the arm: what IMUs state where nothing else does."""
        return (*self.plates, *self.markers, *self.curvatures, *self.bends) or self.attitudes

    @property
    def attitudes(self) -> tuple[Attitude, ...]:
        """Rotations that IMUs state."""
        stated = (imu.attitude() for imu in self.imus)
        return tuple(attitude for attitude in stated if attitude is not None)

    @property
    def streams(self) -> tuple[Stream, ...]:
        """All streams."""
        driving = tuple(each for each in (self.command, self.duty) if each is not None)
        seen = (*self.plates, *self.markers, *self.curvatures, *self.bends, *self.imus)
        return (self.pressure, *driving, *seen)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s] at which both pressures and shape, if there is any, are known."""
        streams: tuple[Stream, ...] = (*self.shapes, *self.imus)
        shown = [stream for stream in streams if stream.t.size] or [self.pressure]
        starts, ends = [float(s.t[0]) for s in shown], [float(s.t[-1]) for s in shown]
        return max(min(starts), float(self.pressure.t[0])), min(max(ends), float(self.pressure.t[-1]))

    def window(self, start: float, end: float) -> Recording:
        """Return the samples with start <= t < end [s] of all streams; stamps stay as they are."""
        return self._with({stream.name: stream.window(start, end) for stream in self.streams})

    def renamed(self, name: str) -> Recording:
        """Return the recording under another name."""
        return replace(self, name=name)

    def shifted(self, stream: str, seconds: float) -> Recording:
        """Return the recording with the stamps of one stream grown by a number of seconds.

        Raises
        ------
        ConfigError
            If there is no stream of that name.
        """
        known = {each.name: each for each in self.streams}
        if stream not in known:
            raise ConfigError(self.name, "stream", stream, f"one of {', '.join(known)}")
        return self._with({stream: known[stream].shifted(seconds)})

    def _with(self, changed: dict[str, Stream]) -> Recording:
        """Return the recording with other streams under some of the names."""
        groups = ("plates", "markers", "curvatures", "bends", "imus")
        values = {
            group: tuple(changed.get(each.name, each) for each in getattr(self, group)) for group in groups
        }
        pressure = changed.get(self.pressure.name, self.pressure)
        command = self.command and changed.get(self.command.name, self.command)
        duty = self.duty and changed.get(self.duty.name, self.duty)
        return replace(self, pressure=pressure, command=command, duty=duty, **values)  # type: ignore[arg-type]
