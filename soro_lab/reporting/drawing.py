"""Figures as images of a page: drawings as SVG, dense lines as PNG of few colours."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Image:
    """An image; `ending` is that of its file, svg or png."""

    data: bytes
    ending: str

    @property
    def address(self) -> str:
        """The image as an address, for a page that has it in itself."""
        kind = "svg+xml" if self.ending == "svg" else self.ending
        return f"data:image/{kind};base64,{base64.b64encode(self.data).decode()}"


def style() -> dict[str, object]:
    """Return the settings of all figures of a report, for `matplotlib.rc_context`."""
    return dict(_STYLE)


def svg(figure: Figure) -> Image:
    """Return a figure as a drawing."""
    with mpl.rc_context(_STYLE), io.BytesIO() as file:
        figure.savefig(file, format="svg", metadata={"Date": None})
        return Image(file.getvalue(), "svg")


def png(figure: Figure, colours: int = 64) -> Image:
    """Return a figure of many points in few colours."""
    from PIL import Image as Pixels

    with io.BytesIO() as drawn, io.BytesIO() as small:
        figure.savefig(drawn, format="png", dpi=150)
        with Pixels.open(drawn) as image:
            image.convert("RGB").quantize(colours, Pixels.Quantize.MAXCOVERAGE).save(
                small, format="png", optimize=True
            )
        return Image(small.getvalue(), "png")
