"""The lines on the greatest stretch of a part, on the limit of its material and on published cycles."""

import csv

import pytest
from typer.testing import CliRunner

from soro_core.errors import ConfigError
from soro_design.commands.fem import app
from soro_design.fem.elements.material import load_material, material_from_dict
from soro_design.parts.strength import strength_lines
from tests.soro_design.fem.small_parts import TUBE, written

RUBBER = {"kind": "hyperelastic", "name": "rubber", "source": "made up", "c1_pa": 1e5, "poisson_ratio": 0.49}
TESTS = [
    {"stretch": 2.0, "cycles": 1e5, "source": "paper A"},
    {"stretch": 3.0, "cycles": 2e3, "source": "paper B"},
]


def material(**strength):
    return material_from_dict({**RUBBER, "strength": {"break_stretch": 5.0, "source": "sheet", **strength}})


def test_the_limit_and_the_cycles_are_named():
    stretch, cycles = strength_lines(material(fatigue=TESTS), "one", 2.5)
    assert stretch == (
        "Greatest stretch of an element: 2.5 in sweep one; rubber breaks at 5 in one pull (sheet); 38 % of"
        " its elongation."
    )
    # The test at 2 is gentler than the part.
    assert cycles == "Cycles: at least 2e+03, as a test at stretch 3 has (paper B)."
    assert "1e+05" in strength_lines(material(fatigue=TESTS), "one", 1.5)[1]


def test_what_is_not_known_is_said():
    assert "no published test stretches so far" in strength_lines(material(fatigue=TESTS), "one", 4.0)[1]
    assert "no published test." in strength_lines(material(), "one", 1.5)[1]
    (line,) = strength_lines(material_from_dict(RUBBER), "one", 1.5)
    assert "no limit and no test" in line
    assert "beyond that: 112 %" in strength_lines(material(), "one", 5.5)[0]
    assert "not known" in strength_lines(material(), "", 0.0)[0]


def test_a_limit_below_1_is_refused():
    with pytest.raises(ConfigError, match=r"strength\.break_stretch"):
        material_from_dict({**RUBBER, "strength": {"break_stretch": 0.9, "source": "sheet"}})


def test_shipped_limits_are_of_their_sheets():
    found = {
        name: load_material(name).strength.break_stretch
        for name in ("dragonskin_10", "dragonskin_30", "ecoflex_00_30", "elastic_50a")
    }
    elongations = {"dragonskin_10": 10.0, "dragonskin_30": 3.64, "ecoflex_00_30": 9.0, "elastic_50a": 1.6}
    assert found == pytest.approx({name: 1.0 + each for name, each in elongations.items()})


@pytest.mark.slow
def test_a_run_names_the_stretch_of_its_tube(tmp_path):
    """A thin ring that grows by a share of its radius is stretched by it."""
    thin = {**TUBE["geometry"], "inner_radius_m": 0.0078, "across": 1, "along": 2}
    sweeps = [{"name": "blown", "pressures_pa": [1e3], "states": 2}]
    part = written(tmp_path, {**TUBE, "geometry": thin}, sweeps=sweeps)
    done = CliRunner().invoke(app, ["run", str(part), "--out", str(tmp_path / "fem")])
    assert done.exit_code == 0, done.output
    with (tmp_path / "fem" / "table.csv").open(encoding="utf-8") as stream:
        last = list(csv.DictReader(stream))[-1]
    inside = 1.0 + float(last["radius_change_m"]) / 0.0078
    assert inside > 1.05
    assert float(last["greatest_stretch"]) == pytest.approx(inside, rel=0.02)
    assert f"element: {float(last['greatest_stretch']):.3g} in sweep blown" in done.output
