"""Topology optimisation of soft parts that air under pressure drives (docs/design.md)."""

from soro_core.design.check import Reanalysis, Shape, reanalyse, shape
from soro_core.design.domain import Domain, make_domain
from soro_core.design.optimise import Row, State, load_state, optimise, save
from soro_core.design.task import Task, load_task, task_from_dict

__all__ = [
    "Domain",
    "Reanalysis",
    "Row",
    "Shape",
    "State",
    "Task",
    "load_state",
    "load_task",
    "make_domain",
    "optimise",
    "reanalyse",
    "save",
    "shape",
    "task_from_dict",
]
