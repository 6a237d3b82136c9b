"""Topology optimisation of soft parts that air under pressure drives (docs/design.md)."""

from soro_design.topology.check import FinalPart, Reanalysis, reanalyse, shape
from soro_design.topology.domain import Domain, make_domain
from soro_design.topology.optimise import IterationRow, OptimiserState, load_state, optimise, save
from soro_design.topology.task import Task, load_task, task_from_dict

__all__ = [
    "Domain",
    "FinalPart",
    "IterationRow",
    "OptimiserState",
    "Reanalysis",
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
