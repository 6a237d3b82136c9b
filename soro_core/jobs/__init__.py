"""Many jobs: one after the other, in threads, in processes or on a cluster, with the same results."""

from soro_core.jobs.executors import Executor as Executor
from soro_core.jobs.executors import Here as Here
from soro_core.jobs.executors import Processes as Processes
from soro_core.jobs.executors import Threads as Threads
from soro_core.jobs.executors import all_cores as all_cores
from soro_core.jobs.jobs import executor_of as executor_of
from soro_core.jobs.jobs import given_or_threads as given_or_threads
from soro_core.jobs.jobs import map_jobs as map_jobs
