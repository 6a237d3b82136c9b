"""The folder of a study: what was asked, the rows that are done, and the table that is made of them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from soro_core.errors import ConfigError
from soro_core.jobs.versions import fingerprint
from soro_ros.study.runs import FIGURES, VariedScene

_ASKED, _ROWS, TABLE = "study.json", "runs.jsonl", "runs.parquet"


def asked(varied: VariedScene) -> dict[str, Any]:
    """Return what the rows of a study follow from, as plain values."""
    scene = varied.scene
    platform = scene.loaded_platform
    found = {
        "soro": fingerprint(),
        "SCENE": {
            **scene.to_dict(),
            "robot": scene.loaded_robot.model_dump(mode="json"),
            "platform": None if platform is None else platform.model_dump(mode="json"),
        },
        "--vary": varied.file.model_dump(mode="json", exclude_unset=True),
    }
    plain: dict[str, Any] = json.loads(json.dumps(found))
    return plain


class StudyFolder:
    """Keeps each row as soon as it is there.

    Parameters
    ----------
    path : Path
        Made, where it does not exist.
    asked : mapping
        What the rows follow from.

    Raises
    ------
    ConfigError
        If the folder has rows of something else, or cannot be written to.
    """

    def __init__(self, path: Path, asked: Mapping[str, Any]) -> None:
        self.path, self._rows = path, path / _ROWS
        try:
            path.mkdir(parents=True, exist_ok=True)
            if (path / _ASKED).exists():
                self._compare(json.loads((path / _ASKED).read_text(encoding="utf-8")), asked)
            else:
                (path / _ASKED).write_text(json.dumps(asked, indent=1) + "\n", encoding="utf-8")
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
        """Write the rows as a table; values of keys that are no numbers and no texts stand in it as JSON.

        Parameters
        ----------
        keys : sequence of str
            Those that vary.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        kinds = {"run": pa.int64(), **dict.fromkeys(FIGURES, pa.float64())}
        kinds |= {"verdict": pa.string(), "reason": pa.string()}
        columns = {}
        for name in ("run", *keys, *FIGURES, "verdict", "reason"):
            values = [row[name] for row in self.in_order]
            if name in keys:
                kinds[name], values = _column(values, pa)
            columns[name] = pa.array(values, kinds[name])
        pq.write_table(pa.table(columns), self.path / TABLE)
        return self.path / TABLE

    def _read(self) -> dict[int, dict[str, Any]]:
        """Return the rows that are there; the last one may be cut, where the computer was switched off."""
        if not self._rows.exists():
            return {}
        whole, _, cut = self._rows.read_text(encoding="utf-8").rpartition("\n")
        if cut:
            self._rows.write_text(whole + "\n" if whole else "", encoding="utf-8")
        rows = [json.loads(line) for line in whole.splitlines()]
        return {row["run"]: row for row in rows}

    def _compare(self, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
        for name, value in now.items():
            if before.get(name) != value:
                got = before.get(name) if name == "soro" else f"runs of another {name}"
                allowed = f"runs of this {name}, or a new folder: --out FOLDER"
                raise ConfigError(str(self.path), name, got, allowed)


def _column(values: Iterable[Any], pa: Any) -> tuple[Any, list[Any]]:
    """Return the type of a column and its values."""
    values = list(values)
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        return pa.int64(), values
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return pa.float64(), [float(value) for value in values]
    if all(isinstance(value, str) for value in values):
        return pa.string(), values
    return pa.string(), [json.dumps(value) for value in values]
