"""What a run submits to a cluster; tests/runs/test_resume.py has the bytes that come back."""

from types import SimpleNamespace

import numpy as np
import pytest

from rigidmc.runs.directory import cluster


class Client:
    """A client whose cluster has `threads` threads and finishes nothing."""

    def __init__(self, threads):
        self.threads = threads

    def nthreads(self):
        """Return {worker: threads}; none before the first worker."""
        return {"worker": self.threads} if self.threads else {}

    def submit(self, function, *arguments, key):
        """Submit a task."""
        return key

    def map(self, function, numbers, key, **given):
        """Submit tasks."""
        assert given["texts"].endswith("-files")  # a task, which is repeated if its worker is lost
        return key


@pytest.fixture
def tasks(monkeypatch):
    """A function that makes the tasks of ten shards."""
    monkeypatch.setattr(cluster, "RECOUNT", -1.0)
    directory = SimpleNamespace(path="run")

    def make(client, stop=None):
        given = {"texts": (b"",), "how": cluster.Resume(stop=stop), "work": None}
        return cluster._Tasks(client, "tcp://", directory, np.arange(10), given)

    return make


def test_a_cluster_that_grows_gets_more_tasks(tasks):
    client = Client(0)
    some = tasks(client)
    assert len(some._submit()) == cluster.AHEAD  # without tasks no worker would start
    assert some._submit() == []
    client.threads = 3
    assert [key[-2:] for key in some._submit()] == ["-2", "-3", "-4", "-5"]
    client.threads = 100
    assert [key[-2:] for key in some._submit()] == ["-6", "-7", "-8", "-9"]
    assert some._submit() == []


def test_no_task_begins_after_the_time_limit(tasks):
    assert tasks(Client(2), stop=0.0)._submit() == []
