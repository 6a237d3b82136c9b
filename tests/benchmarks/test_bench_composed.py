"""The loop in one process is measured, and a soak tells what grows; no time is asserted."""

import pytest
from result_tables import tables, written

from benchmarks.soak import MOST_MB, Look, growth


@pytest.mark.process
@pytest.mark.timeout(300)
def test_the_cycles_of_the_loop_in_one_process(tmp_path):
    rates, parts = tables(written(tmp_path, "composed"))
    assert [row["cycles"] for row in rates] == ["50"]
    assert float(rates[0]["CPU a cycle, ms"]) > 0.0
    costs = {row["part"]: float(row["us a cycle"]) for row in parts}
    assert {"controller", "estimator", "twin", "limiter", "rest", "whole"} == costs.keys()
    assert min(costs.values()) > 0.0
    # Where the hooks of the measurement are dead, no work begins or ends.
    assert "-" not in (rates[0]["work ends after, ms"], rates[0]["begins late, ms"])


def looks(per_s: float, handles: int) -> list[Look]:
    """Looks of ten minutes: caches fill in the first one, then so much memory [MB/s] and so many handles."""
    return [
        Look(t, 200.0 + min(t, 60.0) + per_s * t, 20 + handles * (t > 300.0), 9, 0.0, 0, 0)
        for t in map(float, range(600))
    ]


def test_growth_is_that_after_the_warm_up():
    assert abs(growth(looks(0.0, 0), "rss_mb")) < 0.01
    assert growth(looks(0.01, 0), "rss_mb") == pytest.approx(4.8, rel=0.01)
    assert growth(looks(0.01, 0), "rss_mb") > MOST_MB
    assert growth(looks(0.0, 1), "handles") > 0.5
    assert abs(growth(looks(0.0, 0), "handles")) < 1e-9
