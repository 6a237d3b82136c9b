"""The messages of a topic as the rows of a table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from soro_ros.conversion.fields import Value, flat, is_joint_state
from soro_ros.conversion.units import column_of

LOG_TIME = "log_time_ns"
# A table with more columns is no table: an image, a point cloud.
MOST_COLUMNS = 2000


@dataclass
class TopicTable:
    """Columns of a topic, found in its messages.

    Attributes
    ----------
    topic : str
    columns : dict of str to type
        Type of each path, in the order of the columns.
    names : list of str or None
        Names that every JointState with values has; None where there are none, or several.
    """

    topic: str
    columns: dict[str, type[Value]] = field(default_factory=dict)
    names: list[str] | None = None

    def learn(self, messages: Iterable[Any]) -> None:
        """Find the columns of some messages.

        Raises
        ------
        ValueError
            If there are too many.
        """
        by_number: dict[str, type[Value]] = {}
        by_name: dict[str, type[Value]] = {}
        same = True
        for message in messages:
            same = same and is_joint_state(message)
            for path, value in flat(message, by_name=False).items():
                by_number.setdefault(path, type(value))
            if len(by_number) > MOST_COLUMNS:
                raise ValueError(f"more than {MOST_COLUMNS} values in a message")
            if same:
                same = self._same_names(message)
                by_name |= {p: type(v) for p, v in flat(message).items() if p not in by_name}
        if not same:
            self.names = None
        named = self.names is not None
        columns = by_name if named else by_number
        self.columns = {p: t for p, t in columns.items() if not (named and p.startswith("name."))}

    def row(self, message: Any) -> dict[str, Value]:
        """Return the values of a message by the name of their column."""
        values = flat(message, by_name=self.names is not None)
        return {column_of(self.topic, path): values[path] for path in self.columns if path in values}

    def headings(self) -> dict[str, type[Value]]:
        """Return the names of the columns with their types."""
        return {column_of(self.topic, path): kind for path, kind in self.columns.items()}

    def _same_names(self, message: Any) -> bool:
        """Whether names can be left to the headings: the same in all messages that have values."""
        lengths = {len(message.position), len(message.velocity), len(message.effort)} - {0}
        if not message.name:
            return not lengths
        if self.names is None and len(set(message.name)) == len(message.name):
            self.names = list(message.name)
        return list(message.name) == self.names and lengths == {len(self.names)}
