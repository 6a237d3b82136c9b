"""Recordings of an arm for identification: read, cleaned, cut into states at rest, decays and sections."""

from soro_lab.identification.recording.phases import Phase, decays, excited
from soro_lab.identification.recording.place import Place, place_of_part
from soro_lab.identification.recording.recording import OmittedSamples, Recording
from soro_lab.identification.recording.rest import Mean, RestState, rest_states
from soro_lab.identification.recording.sections import RecordingSegment, SectionLimits, hold_out, sections
from soro_lab.identification.recording.sources.columns import Columns
from soro_lab.identification.recording.sources.from_bag import read_bag
from soro_lab.identification.recording.sources.from_csv import read_csv
from soro_lab.identification.recording.sources.manual_release import without_hands
from soro_lab.identification.recording.sources.names import check_names
from soro_lab.identification.recording.stale import StaleLimits
from soro_lab.identification.recording.stillness import StillLimits, check_motion, moves, still_limits
from soro_lab.identification.recording.streams import (
    Bend,
    Curvature,
    Imu,
    Marker,
    Plate,
    Series,
    Stream,
)
from soro_lab.identification.recording.summary import summary

__all__ = [
    "Bend",
    "Columns",
    "Curvature",
    "Imu",
    "Marker",
    "Mean",
    "OmittedSamples",
    "Phase",
    "Place",
    "Plate",
    "Recording",
    "RecordingSegment",
    "RestState",
    "SectionLimits",
    "Series",
    "StaleLimits",
    "StillLimits",
    "Stream",
    "check_motion",
    "check_names",
    "decays",
    "excited",
    "hold_out",
    "moves",
    "place_of_part",
    "read_bag",
    "read_csv",
    "rest_states",
    "sections",
    "still_limits",
    "summary",
    "without_hands",
]
