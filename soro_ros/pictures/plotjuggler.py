"""A layout of PlotJuggler for a recording: pressures, tip and its error, strains, diagnostics."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from soro_core.errors import BagError
from soro_lab.bag import BagReader
from soro_ros.conversion.decoding import Messages
from soro_ros.pictures.panels import is_weight

# What /diagnostics has of each node, as far as it is a number.
_KEYS = ("lateness_p50_ms", "lateness_p99_ms", "overruns", "frames_lost", "lost", "dropped")
_COLOURS = ("#1f77b4", "#d62728", "#1ac938", "#ff7f0e", "#9467bd", "#17becf", "#bcbd22", "#f14cc1")
_ERROR = "tip error [mm]"


def layout(bag: Path, arm: str) -> str:
    """Return the XML of a layout whose curves are those of a recording.

    Series have the names that PlotJuggler gives them: ``TOPIC/JOINT/effort`` of a JointState,
    ``/diagnostics/HARDWARE_ID/NODE/KEY``, and else the path of the field.

    Parameters
    ----------
    bag : Path
    arm : str
        Namespace of the arm.

    Raises
    ------
    BagError
        If the bag has none of the topics.
    """
    begin = f"/{arm}/" if arm else "/"
    with BagReader(bag) as reader:
        joints = {
            name: _joints(reader, begin + name)
            for name in ("chambers/command", "chambers/state", "arm/state", "controller/estimates")
        }
        tips = [name for name in ("arm/tip", "arm/desired/tip") if reader.count(begin + name)]
        diagnostics = _diagnostics(reader)
    pressures = [f"{begin}{topic}/{joint}/effort" for topic in list(joints)[:2] for joint in joints[topic]]
    strains = [f"{begin}arm/state/{joint}/position" for joint in joints["arm/state"]]
    learned = [
        f"{begin}controller/estimates/{joint}/position"
        for joint in joints["controller/estimates"]
        if not is_weight(joint)
    ]
    places = {"arm/tip": "pose/pose/position", "arm/desired/tip": "pose/position"}
    tip = [f"{begin}{name}/{places[name]}/{axis}" for name in tips for axis in "xyz"]
    error = [_ERROR] if len(tips) == 2 else []
    tabs = (
        ("Arm", [pressures, tip, error]),
        ("Strains and load", [strains, learned]),
        ("Diagnostics", [[name for name in diagnostics if name.endswith(f"/{key}")] for key in _KEYS]),
    )
    if not any(curves for _, plots in tabs for curves in plots):
        raise BagError("no topic that a layout shows", bag, "missing")
    root = Element("root")
    window = SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    for name, plots in tabs:
        if shown := [curves for curves in plots if curves]:
            _tab(window, name, shown)
    SubElement(window, "currentTabIndex", index="0")
    SubElement(root, "use_relative_time_offset", enabled="1")
    equations = SubElement(root, "customMathEquations")
    if error:
        _equation(equations, tip)
    SubElement(root, "snippets")
    ElementTree.indent(root, " ")
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _tab(window: Element, name: str, plots: Sequence[Sequence[str]]) -> None:
    container = SubElement(SubElement(window, "Tab", tab_name=name, containers="1"), "Container")
    share = ";".join([f"{1 / len(plots):.6f}"] * len(plots))
    splitter = SubElement(container, "DockSplitter", orientation="-", count=str(len(plots)), sizes=share)
    for curves in plots:
        area = SubElement(splitter, "DockArea", name="...")
        plot = SubElement(area, "plot", mode="TimeSeries", style="Lines", flip_x="false", flip_y="false")
        SubElement(plot, "range", left="0.000000", right="1.000000", top="1.000000", bottom="0.000000")
        SubElement(plot, "limitY")
        for k, curve in enumerate(curves):
            SubElement(plot, "curve", name=curve, color=_COLOURS[k % len(_COLOURS)])


def _equation(equations: Element, tip: Sequence[str]) -> None:
    """The distance of two points, whose series are x, y, z of the one and of the other."""
    snippet = SubElement(equations, "snippet", name=_ERROR)
    SubElement(snippet, "global")
    function = SubElement(snippet, "function")
    function.text = "return 1000 * math.sqrt((value - v3)^2 + (v1 - v4)^2 + (v2 - v5)^2)"
    SubElement(snippet, "linked_source").text = tip[0]
    sources = SubElement(snippet, "additional_sources")
    for k, name in enumerate(tip[1:], 1):
        SubElement(sources, f"v{k}").text = name


def _joints(reader: BagReader, topic: str) -> list[str]:
    """Names of a JointState, of the first message that has some; none if there is no such message."""
    if not reader.count(topic) or reader.topic(topic).type != "sensor_msgs/msg/JointState":
        return []
    for _, message in Messages(reader, {topic: JointState})():
        if message.name:
            return list(message.name)
    return []


def _diagnostics(reader: BagReader) -> list[str]:
    found: dict[str, None] = {}
    for _, message in Messages(reader, {"/diagnostics": DiagnosticArray})():
        for status in message.status:
            begin = "/".join(part for part in ("/diagnostics", status.hardware_id, status.name) if part)
            for pair in status.values:
                if pair.key in _KEYS:
                    found[f"{begin}/{pair.key}"] = None
    return sorted(found)
