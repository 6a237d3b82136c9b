"""Recordings in rosbag2's MCAP layout, written, read and repaired without ROS."""

from soro_lab.bag.background import BackgroundWriter as BackgroundWriter
from soro_lab.bag.definitions import Definition as Definition
from soro_lab.bag.definitions import find_definition as find_definition
from soro_lab.bag.metadata import Metadata as Metadata
from soro_lab.bag.reader import BagMessage as BagMessage
from soro_lab.bag.reader import BagReader as BagReader
from soro_lab.bag.repair import PartRepair as PartRepair
from soro_lab.bag.repair import repair as repair
from soro_lab.bag.topics import INFINITE_NS as INFINITE_NS
from soro_lab.bag.topics import Qos as Qos
from soro_lab.bag.topics import Span as Span
from soro_lab.bag.topics import Topic as Topic
from soro_lab.bag.writer import BagWriter as BagWriter
