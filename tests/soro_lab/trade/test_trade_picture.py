"""The picture can be read: the legend hides nothing, and labels stand apart."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from small import robot

from soro_core.robot import Discretisation
from soro_lab.scene import Requirement
from soro_lab.trade import Candidate, CandidateResult, Study, bare_case
from soro_lab.trade.cost import Cost
from soro_lab.trade.picture import draw, logarithmic, picture
from soro_lab.trade.reference import ReferenceRun
from soro_lab.trade.trace import Errors, TradeTrace

SPACES = [Discretisation(basis="legendre", order=k, links=n) for k in (1, 2, 3, 4, 6) for n in (1, 2, 4)]
MODELS = [Discretisation(links=k) for k in (1, 2, 4)] + [Discretisation(method="mde", steps=9)]


def study(models, requirement):
    """A study of made-up figures."""
    rng = np.random.default_rng(1)
    rows = []
    for k, model in enumerate(models):
        tip = 10.0 * 0.5**k
        cost = Cost(2e-3 * 1.3**k, 1.0, 50.0 * 1.2**k, 40.0, 0.1, 3)
        errors = Errors(tip, tip, float(rng.random()), None)
        rows.append(CandidateResult(Candidate(model, "trapezoidal", 0.01), errors, cost=cost))
    trace = TradeTrace(np.zeros((1, 5, 3)), np.zeros(1), 1.0)
    truth = ReferenceRun(rows[-1].candidate, trace, Errors(0.01, 0.01, 0.01, None), 0.02, "")
    return Study(bare_case(robot()), requirement, truth, tuple(rows), 100)


@pytest.mark.parametrize("models", [MODELS, SPACES], ids=["few", "many"])
@pytest.mark.parametrize(
    "requirement", [Requirement(error="1%"), Requirement(rate_hz=500)], ids=["error", "rate"]
)
def test_the_legend_is_apart_from_the_plot(models, requirement):
    figure = picture(study(models, requirement))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    axes, legend = figure.axes[0], figure.legends[0]
    box = legend.get_window_extent()
    assert not box.overlaps(axes.get_tightbbox())
    assert 0.0 <= box.x0 < box.x1 <= figure.bbox.x1
    assert 0.0 <= box.y0 < box.y1 <= figure.bbox.y1
    colours = {str(key.get_color()) for key in legend.legend_handles if key.get_marker() == "s"}
    assert len(colours) == len({Candidate(m, "", 1.0).space for m in models})
    assert axes.get_position().height * figure.bbox.height > 350


def test_nothing_measured_is_no_picture(tmp_path):
    none = replace(study(MODELS, Requirement(error="1%")), rows=())
    assert not draw(none, tmp_path / "none.png")
    assert not (tmp_path / "none.png").exists()


@pytest.mark.parametrize("span", [1.0, 1.5, 4.0, 17.0, 90.0, 400.0, 1e5, 1e8])
def test_labels_of_logarithmic_axes_stand_apart(span):
    figure = Figure(figsize=(5.0, 4.4), layout="constrained")
    axes = figure.subplots()
    axes.plot([12.0, 12.0 * span], [0.004, 0.004 * span], "o")
    logarithmic(axes)
    FigureCanvasAgg(figure).draw()
    for axis in (axes.xaxis, axes.yaxis):
        low, high = axis.get_view_interval()
        shown = [t for t in axis.get_major_ticks() if low <= t.get_loc() <= high and t.label1.get_text()]
        boxes = [tick.label1.get_window_extent() for tick in shown]
        assert len(boxes) >= 2
        assert not any(one.overlaps(other) for one, other in pairwise(boxes))
        assert not any(tick.label1.get_text() for tick in axis.get_minor_ticks())
