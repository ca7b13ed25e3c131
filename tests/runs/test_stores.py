"""Run directories in object stores: the same objects as the files of a run here, byte by byte."""

import contextlib
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import urllib.request
from pathlib import Path
from unittest.mock import patch

import fsspec
import numpy as np
import pytest

import rigidmc as rm
from rigidmc.errors import FileError, OutputExists
from rigidmc.files import stores
from rigidmc.files.outputs import content_of
from rigidmc.runs.directory import cluster, gather, resume
from rigidmc.runs.directory import folder as run_directory
from rigidmc.runs.directory.create import create
from rigidmc.runs.directory.facts import facts_text
from rigidmc.runs.directory.folder import FILES, RunDirectory
from tests.tools.commands import invoke
from tests.tools.scenes import FREE
from tests.tools.torture import sums

ROOT = Path(__file__).resolve().parents[2]
SCENE = FREE.with_run(members=160)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run of five shards here."""
    path = tmp_path_factory.mktemp("runs") / "whole"
    facts = create(SCENE, path, 1.0).facts
    (path / "run.json").write_text(facts_text({**facts, "block": 32, "shard": 32}))
    resume.resume(path, threads=1)
    return path


def begun(whole, url):
    """The same run at a URL, without shards."""
    store = stores.Store(url)
    for name in FILES:
        if data := content_of(whole, name):
            store.put(name, data)
    return url


def objects(url):
    """Return {name: sha256} of the shards at a URL."""
    store = stores.Store(url)
    return {
        name: hashlib.sha256(store.get(f"shards/{name}")).hexdigest()
        for name in store.listed("shards")
    }


def use(whole, url, folder):
    """Write a run in a store in parts, read it in every way, and copy it both ways."""
    begun(whole, url)
    resume.resume(url, threads=1, only=range(1, 3))
    facts = run_directory.status(url)
    assert (facts["done"], facts["shards"], facts["members_done"], facts["strays"]) == (2, 5, 64, 0)
    assert facts["rate"] > 0.0
    with pytest.warns(rm.SceneWarning, match="64 of 160"), rm.open(url) as part:
        assert part.member.values.tolist() == list(range(32, 96))
    resume.resume(f"{url}/", threads=1)
    assert objects(url) == sums(whole)  # names and bytes
    assert gather.verify(url, spot=1, threads=1) == []
    with rm.open(url) as there, rm.open(whole) as here:
        assert there.omega.values.tobytes() == here.omega.values.tobytes()
        assert there.encoding["source"] == url
    for source, name in ((url, "there.nc"), (whole, "here.nc")):
        gather.consolidate(source, folder / name).close()
    assert (folder / "there.nc").read_bytes() == (folder / "here.nc").read_bytes()
    assert gather.merge(folder / "copy", [url])[1] == 5 and sums(folder / "copy") == sums(whole)
    assert gather.merge(f"{url}-up", [whole])[1] == 5 and objects(f"{url}-up") == sums(whole)
    assert gather.merge(f"{url}-up", [whole, url])[1] == 0


def test_a_store_has_the_bytes_of_a_run_here(whole, tmp_path):
    use(whole, f"memory://{tmp_path.name}/run", tmp_path)


def test_a_damaged_object_is_found_and_mended(whole, tmp_path):
    url = f"memory://{tmp_path.name}"
    gather.merge(url, [whole])
    store, name = stores.Store(url), sorted(sums(whole))[3]
    data = bytearray(store.get(f"shards/{name}"))
    data[len(data) // 2] ^= 1
    store.put(f"shards/{name}", bytes(data))
    store.put("shards/stray.txt", b"")
    faults = gather.verify(url, spot=0)
    assert len(faults) == 2 and faults[0].startswith(f"{url}/shards/{name}: was changed")
    assert gather.repair(url) == 2 and run_directory.status(url)["done"] == 4
    resume.resume(url, threads=1)
    assert objects(url) == sums(whole)


def test_two_writers_without_a_lock_do_no_harm(whole, tmp_path):
    """What needs a lock is refused; a shard written twice is the same object."""
    url = begun(whole, f"memory://{tmp_path.name}")
    one, other, here = RunDirectory(url), RunDirectory(url), cluster.Resume()
    with one.locked(), other.locked():
        texts = tuple(content_of(one.folder, name) for name in FILES)
        # as workers that reach the store: the bytes do not pass the client, and no task lists the
        # shards, which may be 100,000
        with patch.object(RunDirectory, "listed", side_effect=AssertionError):
            assert [cluster.shard(3, url, texts, here).data for _ in range(2)] == [None, None]
        unreached = cluster.shard(2, f"{url}/nothing", texts, here)
        cluster._store(unreached, "tcp://", other)
    assert objects(url).items() <= sums(whole).items() and len(objects(url)) == 2
    for refused in (
        lambda: resume.extend(url, 320),
        lambda: resume.add_members(one, np.arange(3), 0),
    ):
        with pytest.raises(FileError, match="needs a lock"):
            refused()
    with pytest.raises(OutputExists, match="nothing was written"):
        create(SCENE, url)
    with (  # both have looked before one writes
        patch.object(stores.Store, "listed", dict),
        pytest.raises(OutputExists, match=r"scene.toml appeared meanwhile"),
    ):
        create(SCENE, url)
    assert stores.Store(url).get("run.json") == (whole / "run.json").read_bytes()


def test_a_store_that_fails_is_one_clear_error(tmp_path):
    missing = ImportError("no s3fs")
    for url, words, fault in (
        ("nope://x/y", "not a store that fsspec knows", None),
        ("memori://x/y", "did you mean 'memory://'", None),
        ("s3://x/y", "pip install s3fs", missing),
        (f"memory://{tmp_path.name}/nothing", "no run.json", None),
        (f"memory://{tmp_path.name}/closed", "access denied: no", PermissionError("no")),
        (f"memory://{tmp_path.name}/gone", "cannot be used: no answer", RuntimeError("no answer")),
    ):  # fmt: skip
        target = fsspec.core if fault is missing else fsspec.get_filesystem_class("memory")
        name = "url_to_fs" if fault is missing else "get_file"
        broken = (
            patch.object(target, name, side_effect=fault) if fault else contextlib.nullcontext()
        )
        with broken:
            done = invoke("status", url)
        assert done.exit_code == 3, done.output
        assert words in " ".join(done.output.split()) and "Traceback" not in done.output
        assert url.partition("://")[0] in done.output


def test_a_path_here_is_no_url():
    for path in ("run", "C://run", "/tmp/a:b", "://x", "s3:/b", "memory://"):
        assert not stores.is_url(path)


@pytest.fixture
def s3(monkeypatch):
    """The URL of a bucket of a local S3 server."""
    boto3, server = pytest.importorskip("boto3"), pytest.importorskip("moto.server")
    pytest.importorskip("s3fs")
    local = server.ThreadedMotoServer(port=0, verbose=False)
    local.start()
    host, port = local.get_host_and_port()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}", "AWS_ACCESS_KEY_ID": "a",
        "AWS_SECRET_ACCESS_KEY": "b", "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_EC2_METADATA_DISABLED": "true",
    }.items():  # fmt: skip
        monkeypatch.setenv(name, value)
    urllib.request.urlopen(f"http://{host}:{port}/moto-api/reset", b"").close()  # of other tests
    boto3.client("s3").create_bucket(Bucket="bucket")
    yield "s3://bucket"
    local.stop()


@pytest.mark.slow  # pytest -m slow tests/runs/test_stores.py
@pytest.mark.filterwarnings("ignore:Port 8787", "ignore:.*unclosed", "ignore:Exception ignored in")
def test_s3_has_the_bytes_of_a_run_here(whole, tmp_path, s3):
    """The same with a local S3 server, and by two processes of a cluster."""
    use(whole, f"{s3}/run", tmp_path)
    url = begun(whole, f"{s3}/cluster")
    resume.resume(url, cluster="local:2")
    assert objects(url) == sums(whole)
    with pytest.raises(FileError, match="there is no bucket 'none'"):
        RunDirectory("s3://none/run")
    with pytest.raises(FileError, match="there is no bucket 'none'"):
        create(SCENE, "s3://none/run")
    with (
        patch.object(stores.Store, "listed", dict),
        pytest.raises(OutputExists, match=r"scene.toml appeared meanwhile"),
    ):
        create(SCENE, url)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("bash"), reason="needs a shell")
def test_the_job_arrays_of_the_page_make_one_run(tmp_path, s3):
    """Three jobs, one of which starts again, in directories and in a store: the run of one job."""
    page = (ROOT / "docs" / "how_to" / "clusters.md").read_text("utf-8")
    job, gather_all, jobs = re.findall(r"```bash\n(.*?)```", page, re.S)
    once, part = jobs.splitlines()
    (tmp_path / "scene.toml").write_text(SCENE.dumps(), "utf-8")
    command = f"{shlex.quote(sys.executable)} -c 'from rigidmc.cli import main; main()'"

    def run(text, number=0):
        for old, new in {"100": "2", "1e9": "20000", "MB 64": "", "-size 64": "-size 0.2"}.items():
            text = text.replace(old, new)
        text = f'rigidmc() {{ {command} "$@"; }}\nI={number}\n{text}'
        environment = {**os.environ, "SLURM_ARRAY_TASK_ID": str(number)}
        words = ["bash", "-e", "-c", text]
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode in (0, 5), done.stdout + done.stderr
        return done.returncode

    run(once.replace(f"{s3}/run/", "all/").partition("--shards")[0])
    assert [run(job, i) for i in (0, 1, 1, 2)] == [0] * 4
    run(gather_all)
    assert sums(tmp_path / "run") == sums(tmp_path / "all") and len(sums(tmp_path / "run")) == 5
    run(once)
    assert [run(part, i) for i in (2, 1, 0)] == [0] * 3
    assert objects(f"{s3}/run") == sums(tmp_path / "all")
