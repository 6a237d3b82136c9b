"""What a part asks of its material: the greatest stretch, and what is published of that material."""

from __future__ import annotations

from soro_design.fem.elements.material import Material, Strength


def strength_lines(material: Material, sweep: str, stretch: float) -> list[str]:
    """Return the lines of a report on the greatest stretch of a part, and on the cycles that it may bear.

    Parameters
    ----------
    material : Material
    sweep : str
        Where the stretch is greatest.
    stretch : float
        Greatest principal stretch of an element, the mean over the element; 0 where it is not known.
    """
    if not stretch:
        return ["Stretch: not known, the folder of states has none; `soro fem run --force` computes it."]
    line = f"Greatest stretch of an element: {stretch:.3g} in sweep {sweep}"
    known = material.strength
    if known is None:
        return [f"{line}; the file of {material.name} has no limit and no test of cycles."]
    share = (stretch - 1.0) / (known.break_stretch - 1.0)
    limit = f"{material.name} breaks at {known.break_stretch:g} in one pull ({known.source})"
    asked = f"beyond that: {100.0 * share:.0f}" if share >= 1.0 else f"{100.0 * share:.2g}"
    return [f"{line}; {limit}; {asked} % of its elongation.", _cycles(material.name, known, stretch)]


def _cycles(name: str, known: Strength, stretch: float) -> str:
    """Return the line on cycles: those of the gentlest test that stretches at least as much as the part."""
    if not known.fatigue:
        return f"Cycles: not known, the file of {name} has no published test."
    harder = [test for test in known.fatigue if test.stretch >= stretch]
    if not harder:
        most = max(known.fatigue, key=lambda test: test.stretch)
        return (
            f"Cycles: no published test stretches so far; at {most.stretch:g} it is {most.cycles:.3g}"
            f" ({most.source})."
        )
    test = min(harder, key=lambda test: test.stretch)
    return f"Cycles: at least {test.cycles:.3g}, as a test at stretch {test.stretch:g} has ({test.source})."
