"""Faults of valves, lines, chambers and sensors, with the air in the chambers of a twin."""

from __future__ import annotations

from benchmarks.options import Options
from tests.apparatus.faults import cells, healthy, results_table, summary
from tests.apparatus.faults.flow import LAG_S, LEAK, NARROW, VALVE, VOLUME_M3, behind_a_twin
from tests.apparatus.faults.matrix import FOUR, MATRIX, air

TITLE = "Faults on the flow into a twin"


def run(options: Options) -> str:
    """Run every row of the air on every family, then each family with nothing wrong, and write."""
    parts = [_INTRO]
    for family in [one for one in MATRIX if one != FOUR]:  # which is an arm of twelve chambers
        results = []
        rows = air(family, NARROW, LEAK)
        for row in rows[: options.pick(len(rows), 1)]:
            options.say(f"{family}: {row.fault}")
            results.append(cells.run(family, row, air=behind_a_twin))
        options.say(f"{family} without a fault")
        end = healthy(family, options.pick(120, 1), behind_a_twin)
        parts += [f"### {family}", summary(results), results_table(results), end]
    return "\n\n".join(parts)


_INTRO = f"""\
As above, on air that a twin moves behind the emulated valves: {1e8 * VALVE.fill_m3_s_pa:g} l/(s bar) after
ISO 6358 on chambers of {1e6 * VOLUME_M3:g} ml, which change with the arm; the bound of a vent is that of this
flow. The monitors expect a lag of {1e3 * LAG_S:g} ms: so this valve follows what the limiter lets through."""
