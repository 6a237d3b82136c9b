"""Many jobs: one after the other, in threads, in processes or on a cluster, with the same results."""

from soro_core.jobs.executors import Executor, Here, Processes, Threads, all_cores
from soro_core.jobs.jobs import executor_of, given_or_threads, map_jobs

__all__ = [
    "Executor",
    "Here",
    "Processes",
    "Threads",
    "all_cores",
    "executor_of",
    "given_or_threads",
    "map_jobs",
]
