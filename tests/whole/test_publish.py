"""The site among its published versions, and the steps of the workflow that publishes it."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "docs" / "publish.py"
WORKFLOW = (ROOT / ".github" / "workflows" / "docs.yml").read_text("utf-8")


@pytest.fixture
def publish():
    spec = importlib.util.spec_from_file_location("publish", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.publish


@pytest.fixture
def site(tmp_path):
    folder = tmp_path / "site"
    (folder / "_static").mkdir(parents=True)
    (folder / "index.html").write_text("home")
    (folder / "_static" / "a.css").touch()
    return folder


def versions(pages):
    entries = json.loads((pages / "versions.json").read_text("utf-8"))
    assert [one["preferred"] for one in entries] == [True] + [False] * (len(entries) - 1)
    return [(one["version"], one["url"]) for one in entries]


def test_versions_are_added_and_the_root_leads_to_the_newest(publish, site, tmp_path):
    pages, home = tmp_path / "pages", "https://some.github.io/Name"
    pages.mkdir()
    publish(site, pages, "dev", "Some/Name")
    assert versions(pages) == [("dev", f"{home}/dev/")]
    assert "url=./dev/" in (pages / "index.html").read_text()
    for version in ("0.9.0", "0.10.0", "0.2.1"):
        publish(site, pages, version, "Some/Name")
    found = [version for version, _ in versions(pages)]
    assert found == ["0.10.0", "0.9.0", "0.2.1", "dev"]
    assert "url=./0.10.0/" in (pages / "index.html").read_text()
    assert (pages / "dev" / "_static" / "a.css").is_file() and (pages / ".nojekyll").is_file()


def test_a_version_is_replaced_as_a_whole(publish, site, tmp_path):
    pages = tmp_path / "pages"
    publish(site, pages, "dev", "some/name")
    (site / "_static" / "a.css").unlink()
    publish(site, pages, "dev", "some/name")
    assert not (pages / "dev" / "_static" / "a.css").exists()


@pytest.mark.parametrize("version", ["main", "../..", "v0.1.0", "0.1", ""])
def test_other_names_are_refused(version, publish, site, tmp_path):
    with pytest.raises(ValueError, match="expected dev"):
        publish(site, tmp_path, version, "some/name")
    assert site.is_dir()


def test_a_site_without_a_home_page_is_refused(publish, site, tmp_path):
    (site / "index.html").unlink()
    with pytest.raises(ValueError, match=r"no index\.html"):
        publish(site, tmp_path / "pages", "dev", "some/name")


def test_the_configuration_names_the_file_of_versions():
    text = (ROOT / "docs" / "conf.py").read_text("utf-8")
    assert '"json_url": f"https://{owner.lower()}.github.io/{name}/versions.json"' in text
    assert "DOCS_VERSION" in text and "DOCS_VERSION" in WORKFLOW


def test_forks_do_nothing_and_one_job_alone_may_write():
    jobs = re.split(r"^  (?=\w+: #)", WORKFLOW.partition("\njobs:\n")[2], flags=re.M)[1:]
    assert len(jobs) == 2 and "\npermissions: {}\n" in WORKFLOW
    assert all("if: ${{ !github.event.repository.fork }}" in job for job in jobs)
    assert ["contents: write" in job for job in jobs] == [False, True]
    assert "pip" not in jobs[1] and "secrets" not in WORKFLOW and "pull_request" not in WORKFLOW


@pytest.mark.skipif(not shutil.which("git") or os.name == "nt", reason="needs git and a shell")
def test_the_steps_that_publish_make_a_branch_and_add_to_it(tmp_path, site):
    """Run against a bare repository in place of the host's."""
    code = WORKFLOW.rpartition("run: |\n")[2]
    here = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_SYSTEM": os.devnull}
    env = {**os.environ, **here, "GITHUB_REPOSITORY": "some/name", "GITHUB_SHA": "abc"}
    env["PATH"] = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])

    def git(*words, at=tmp_path):
        who = "-c", "user.name=a", "-c", "user.email=a@example.org"
        done = subprocess.run(
            ["git", *who, *words], cwd=at, env=env, check=True, capture_output=True, text=True
        )
        return done.stdout

    git("init", "-q", "--bare", "origin")
    git("init", "-q", "-b", "main", "first")
    (tmp_path / "first" / "docs").mkdir()
    shutil.copy(SCRIPT, tmp_path / "first" / "docs")
    git("add", "-A", at=tmp_path / "first")
    git("commit", "-qm", "Begin", at=tmp_path / "first")
    git("push", "-q", str(tmp_path / "origin"), "main", at=tmp_path / "first")
    for number, version in enumerate(("dev", "0.1.0", "0.1.0")):
        clone = tmp_path / f"clone{number}"
        git("clone", "-q", "-b", "main", str(tmp_path / "origin"), str(clone))
        shutil.copytree(site, clone / "site")
        command = ["bash", "-e", "-c", code]
        done = subprocess.run(
            command, cwd=clone, env={**env, "VERSION": version}, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
    listed = git("ls-tree", "-r", "--name-only", "gh-pages", at=tmp_path / "origin").split()
    home = [name for name in listed if name.endswith("index.html")]
    assert home == ["0.1.0/index.html", "dev/index.html", "index.html"]
    assert "docs/publish.py" not in listed
    log = git("log", "--format=%s", "gh-pages", at=tmp_path / "origin").splitlines()
    assert log == ["Publish 0.1.0 of abc", "Publish dev of abc"]  # nothing new: no commit
