"""What the stages of air found, as lines of text and as a YAML file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import yaml

from soro_lab.identification import regulator_fit as air
from soro_lab.identification.fit import Fit
from soro_lab.identification.regulators.stages import FoundAir, FoundPump, FoundRegulators, rounded


def pump_text(found: FoundPump) -> list[str]:
    """Return a line of the pump, and a line of each run held out."""
    valves = found.model.valves
    lines = [
        f"pump: C {1e8 * valves.fill_m3_s_pa:.3g} l/(s bar) at full power, "
        f"stall {valves.supply_pa / 1e3:.3g} kPa, leak {1e8 * valves.leak_m3_s_pa:.3g} l/(s bar), "
        f"dead time {found.model.delay_s:.2f} s"
    ]
    good = sum(abs(one.error) <= air.GOOD for one in found.held_out)
    if found.held_out:
        lines.append(
            f"  t63 within 20 % in {good} of {len(found.held_out)} runs, each by the fit to the others"
        )
    for one in found.held_out:
        error = f"t63 {100 * one.error:+.0f} %, RMS {one.rms_pa / 1e3:.2f} kPa"
        lines.append(f"  {one.run.run}: measured t63 {one.run.t63_s:.2f} s, {error}")
    return lines


def air_yaml(found: FoundAir, names: Sequence[str]) -> str:
    """Return the file of regulators: blocks to paste, then each number with deviation, origin and error."""
    data: dict[str, Any] = {}
    identified: dict[str, Any] = {"recordings": list(names)}
    twin: dict[str, Any] = {}
    shares = found.shares()
    if found.regulators is not None:
        level1, level2 = found.regulators.level1, found.regulators.level2
        data |= air.block(level1.models[""])
        twin = {"air": "states", **data, "valve": air.block(level2.models[""])["twin"]["valve"]}
        identified["regulator"] = _numbers(level1.fits[""], shares["regulator"], "steps of all lines")
        identified["valve"] = _numbers(level2.fits[""], shares["valve"], "steps of all lines")
        identified["valve"]["lines"] = _lines(found.regulators)
    if found.pump is not None:
        identified["pump"] = _numbers(found.pump.fit, shares["pump"], "runs of the pump")
    if found.leaks:
        identified["leaks"] = {}
    for leak in found.leaks:
        name = f"leak of {leak.run.run} {leak.run.line}"
        one = _numbers(leak.fit, shares[name], f"{leak.run.run} after {leak.closed_s:.2f} s")
        identified["leaks"][f"{leak.run.run} {leak.run.line}"] = {"law": leak.law.name, **one}
    if len(found.leaks) == 1:
        # Of several chambers a twin cannot have several leaks.
        twin.setdefault("air", "states")
        value = max(found.leaks[0].conductance(found.volume_m3)[0], 0.0)
        twin["valve"] = {**twin.get("valve", {}), "leak_m3_s_pa": rounded(value)}
    if twin:
        data["twin"] = twin
    head = (
        "# Regulators, pumps and leaks, found by soro identify. Paste `regulator` into a "
        "platform, `twin` into a scene.\n"
    )
    return head + str(yaml.safe_dump({**data, "identified": identified}, sort_keys=False))


def _numbers(fit: Fit, error: float, origin: str) -> dict[str, Any]:
    return {
        "origin": f"fitted to {origin}",
        "held_out_error": rounded(error),
        "numbers": {
            name: {"value": rounded(value), "deviation": rounded(fit.deviations[name])}
            for name, value in fit.values.items()
        },
    }


def _lines(found: FoundRegulators) -> dict[str, Any]:
    """Return the flow of each line, which is the best model; a twin has one for all."""
    fits = found.fits[-1]
    return {
        name: _numbers(fit, float("nan"), f"steps of {name}")["numbers"] for name, fit in fits.fits.items()
    }
