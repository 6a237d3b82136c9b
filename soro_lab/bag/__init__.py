"""Recordings in rosbag2's MCAP layout, written, read and repaired without ROS."""

from soro_lab.bag.background import BackgroundWriter
from soro_lab.bag.definitions import Definition, find_definition
from soro_lab.bag.metadata import Metadata
from soro_lab.bag.reader import BagMessage, BagReader
from soro_lab.bag.repair import PartRepair, repair
from soro_lab.bag.topics import INFINITE_NS, Qos, Span, Topic
from soro_lab.bag.writer import BagWriter

__all__ = [
    "INFINITE_NS",
    "BackgroundWriter",
    "BagMessage",
    "BagReader",
    "BagWriter",
    "Definition",
    "Metadata",
    "PartRepair",
    "Qos",
    "Span",
    "Topic",
    "find_definition",
    "repair",
]
