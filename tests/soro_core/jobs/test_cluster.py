"""Jobs on a Dask cluster of processes: the same results, a killed worker, and versions."""

import os
import signal
from functools import partial
from pathlib import Path

import pytest

from soro_core.errors import ConfigError
from soro_core.jobs import executor_of, map_jobs, versions
from soro_core.jobs.cluster import _called_by

pytestmark = [pytest.mark.process, pytest.mark.filterwarnings("default")]
distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as own:
        yield own


def square(x):
    return x * x


def killed_once(folder, x):
    """Kill the worker at the third job, once."""
    try:
        if x == 3:
            (Path(folder) / "lost").touch(exist_ok=False)
            os.kill(os.getpid(), signal.SIGKILL)
    except FileExistsError:
        pass
    return square(x)


def test_results_come_in_order(cluster):
    with executor_of(1, cluster.scheduler_address) as executor:
        assert list(map_jobs(square, range(30), executor)) == [x * x for x in range(30)]
        assert list(map_jobs(lambda x: x + 1, range(3), executor)) == [1, 2, 3]


def test_a_large_job_is_sent_without_a_warning(cluster, recwarn):
    with executor_of(1, cluster.scheduler_address) as executor:
        assert list(map_jobs(len, [bytes(11_000_000)], executor)) == [11_000_000]
    assert not [str(one.message) for one in recwarn if "large" in str(one.message)]


def test_the_work_of_a_killed_worker_is_done_again(cluster, tmp_path):
    with executor_of(1, cluster.scheduler_address) as executor:
        found = list(map_jobs(partial(killed_once, str(tmp_path)), range(12), executor))
    assert (tmp_path / "lost").exists()
    assert found == [x * x for x in range(12)]


def test_a_worker_of_another_version_is_refused_by_one_line(cluster, monkeypatch):
    other = versions.fingerprint().replace("soro ", "soro 9.")
    monkeypatch.setattr("soro_core.jobs.cluster.fingerprint", lambda: other)
    with pytest.raises(ConfigError, match=r"allowed: workers with soro 9\.") as error:
        executor_of(1, cluster.scheduler_address)
    assert "has soro 0." in str(error.value)
    assert "\n" not in str(error.value)
    monkeypatch.undo()  # a worker that came later answers for itself
    with pytest.raises(ConfigError, match=r"got 'soro 0\."):
        _called_by(other, b"")


def test_a_cluster_without_workers_is_refused(monkeypatch):
    monkeypatch.setattr("soro_core.jobs.cluster._CONNECT_S", 0.5)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0") as empty,
        pytest.raises(ConfigError, match="a cluster with workers"),
    ):
        executor_of(1, empty.scheduler_address)
