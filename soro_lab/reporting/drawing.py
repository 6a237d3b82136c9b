"""Figures as data of an `img` element: drawings as SVG, dense lines as PNG of few colours."""

from __future__ import annotations

import base64
import io

import matplotlib as mpl
from matplotlib.figure import Figure

# Inches of a page's width.
WIDTH = 9.0
MEASURED, PREDICTED, HELD_OUT = ("#1f2933", "#d1495b", "#e8eef5")
COLOURS = ("#1b6ca8", "#e08e2b", "#4f8a4c", "#7b5ea7", "#a0522d", "#3aa6a6", "#8a8f98", "#c75b9b")
_STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "0.45",
    "axes.linewidth": 0.7,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "xtick.color": "0.3",
    "ytick.color": "0.3",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.1,
    "svg.fonttype": "path",
    "svg.hashsalt": "soro",
}


def style() -> dict[str, object]:
    """Return the settings of all figures of a report, for `matplotlib.rc_context`."""
    return dict(_STYLE)


def svg(figure: Figure) -> str:
    """Return a figure as address of an image in the page itself."""
    with mpl.rc_context(_STYLE), io.StringIO() as file:
        figure.savefig(file, format="svg", metadata={"Date": None})
        return _address("image/svg+xml", file.getvalue().encode())


def png(figure: Figure, colours: int = 64) -> str:
    """Return a figure of many points as address of an image in the page itself, in few colours."""
    from PIL import Image

    with io.BytesIO() as drawn, io.BytesIO() as small:
        figure.savefig(drawn, format="png", dpi=150)
        with Image.open(drawn) as image:
            image.convert("RGB").quantize(colours, Image.Quantize.MAXCOVERAGE).save(
                small, format="png", optimize=True
            )
        return _address("image/png", small.getvalue())


def _address(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
