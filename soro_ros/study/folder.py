"""The folder of a study: what was asked, the rows that are done, and the table that is made of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from soro_core.errors import ConfigError
from soro_core.jobs.versions import fingerprint
from soro_ros.study.runs import FIGURES, VariedScene


class StudyFolder:
    """Keeps each row as soon as it is there.

    Parameters
    ----------
    path : Path
        Made, where it does not exist.
    varied : VariedScene
        What the rows follow from.

    Raises
    ------
    ConfigError
        If the folder has rows of something else, or cannot be written to.
    """

    def __init__(self, path: Path, varied: VariedScene) -> None:
        self.path, self._rows, file = path, path / "runs.jsonl", path / "study.json"
        asked = _asked(varied)
        try:
            path.mkdir(parents=True, exist_ok=True)
            before = json.loads(file.read_text(encoding="utf-8")) if file.exists() else asked
            for name, value in asked.items():
                if before.get(name) != value:
                    got = before.get(name) if name == "soro" else f"runs of another {name}"
                    allowed = f"runs of this {name}, or a new folder: --out FOLDER"
                    raise ConfigError(str(path), name, got, allowed)
            file.write_text(json.dumps(asked, indent=1) + "\n", encoding="utf-8")
            self.rows = self._read()
        except (OSError, ValueError) as error:
            raise ConfigError("--out", "", str(path), f"a folder of a study, or none ({error})") from None

    def keep(self, row: Mapping[str, Any]) -> None:
        """Write a row."""
        self.rows[row["run"]] = dict(row)
        with self._rows.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")

    @property
    def in_order(self) -> list[dict[str, Any]]:
        """The rows that are done, by run."""
        return [self.rows[number] for number in sorted(self.rows)]

    def write_table(self, keys: Sequence[str]) -> Path:
        """Write the rows as a table; what varies and is neither numbers nor texts stands in it as JSON."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        kinds = dict.fromkeys(FIGURES, pa.float64())
        columns = {}
        for name in ("run", *keys, *FIGURES, "verdict", "reason"):
            values = [row[name] for row in self.in_order]
            found = {type(value) for value in values}
            if name in keys and not (found == {str} or found <= {int, float}):
                values = [json.dumps(value) for value in values]
            elif found == {int, float}:
                values = [float(value) for value in values]
            columns[name] = pa.array(values, kinds.get(name))
        pq.write_table(pa.table(columns), self.path / "runs.parquet")
        return self.path / "runs.parquet"

    def _read(self) -> dict[int, dict[str, Any]]:
        """Return the rows that are there; the last one may be cut, where the computer was switched off."""
        text = self._rows.read_text(encoding="utf-8") if self._rows.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            self._rows.write_text(whole, encoding="utf-8")
        rows = [json.loads(line) for line in whole.splitlines()]
        return {row["run"]: row for row in rows}


def _asked(varied: VariedScene) -> dict[str, Any]:
    """Return what rows follow from, as plain values."""
    scene, *listed = varied.described
    found = {
        "soro": fingerprint(),
        "SCENE": scene,
        "--vary": varied.file.model_dump(mode="json", exclude_unset=True),
        "--vary files": hashlib.sha256(json.dumps(listed, sort_keys=True).encode()).hexdigest(),
    }
    plain: dict[str, Any] = json.loads(json.dumps(found))
    return plain
