"""Run a notebook without Jupyter, and keep what its cells print and draw in it.

    python docs/run_notebook.py examples/model.ipynb

The cells share one scope. A picture is the figure of `matplotlib.pyplot` that a cell leaves open.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt


def executed(notebook: dict[str, Any]) -> dict[str, Any]:
    """Return the notebook with the outputs of its cells, run in order.

    Parameters
    ----------
    notebook : dict
        Contents of an .ipynb file, format 4.
    """
    plt.close("all")  # what the caller left open is no picture of the first cell
    scope: dict[str, Any] = {"__name__": "__main__"}
    cells, count = [], 0
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            count += 1
            cell = cell | {"execution_count": count, "outputs": _outputs("".join(cell["source"]), scope)}
        cells.append(cell)
    return notebook | {"cells": cells}


def _outputs(code: str, scope: dict[str, Any]) -> list[dict[str, Any]]:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, "cell", "exec"), scope)
    found: list[dict[str, Any]] = []
    if text := printed.getvalue():
        found.append({"output_type": "stream", "name": "stdout", "text": text.splitlines(keepends=True)})
    if plt.get_fignums():
        drawn = io.BytesIO()
        plt.gcf().savefig(drawn, dpi=100, bbox_inches="tight", metadata={"Software": None})
        plt.close("all")
        data = {"image/png": base64.b64encode(drawn.getvalue()).decode(), "text/plain": ["a picture"]}
        found.append({"output_type": "display_data", "data": data, "metadata": {}})
    return found


def main() -> None:
    """Run the notebook of the command line."""
    mpl.use("agg")
    path = Path(sys.argv[1])
    found = executed(json.loads(path.read_text(encoding="utf-8")))
    path.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
