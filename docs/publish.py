"""Put a built site among the published versions: `python docs/publish.py SITE PAGES VERSION`.

PAGES is a checkout of the branch that is published. It has a folder for each version, such as `dev`
or `0.1.0`; `versions.json` for the version switcher; and `index.html`, which leads to the newest
release, or to `dev` while there is none. GITHUB_REPOSITORY decides the addresses.
"""

import json
import os
import re
import shutil
import sys
from pathlib import Path

VERSION = re.compile(r"(\d+)\.(\d+)\.(\d+)")
ROOT = """<!DOCTYPE html>
<html lang="en">
<meta charset="utf-8">
<title>rigidmc</title>
<meta http-equiv="refresh" content="0; url=./{0}/">
<link rel="canonical" href="{1}">
<p><a href="./{0}/">Documentation of rigidmc</a></p>
</html>
"""


def published(pages: Path) -> list[str]:
    """Return the versions in a folder: releases from new to old, then `dev`."""
    names = {path.parent.name for path in pages.glob("*/index.html")}
    releases = [name for name in names if VERSION.fullmatch(name)]
    releases.sort(key=lambda name: tuple(map(int, name.split("."))), reverse=True)
    return [*releases, *(["dev"] if "dev" in names else [])]


def publish(site: Path, pages: Path, version: str, repository: str) -> None:
    """Replace one version, and write `versions.json` and `index.html` of the root.

    Raises ValueError for a version that is neither `dev` nor X.Y.Z, and for a site without a home
    page.
    """
    if version != "dev" and not VERSION.fullmatch(version):
        raise ValueError(f"expected dev or X.Y.Z, got {version}")
    if not (site / "index.html").is_file():
        raise ValueError(f"{site} has no index.html")
    owner, name = repository.split("/")
    home = f"https://{owner.lower()}.github.io/{name}"
    shutil.rmtree(pages / version, ignore_errors=True)
    ignore = shutil.ignore_patterns(".doctrees", ".buildinfo")
    shutil.copytree(site, pages / version, ignore=ignore)
    known = published(pages)
    entries = [
        {"name": one, "version": one, "url": f"{home}/{one}/", "preferred": one == known[0]}
        for one in known
    ]
    entries[0]["name"] += " (stable)" if known[0] != "dev" else ""
    (pages / "versions.json").write_text(json.dumps(entries, indent=1) + "\n", "utf-8")
    (pages / "index.html").write_text(ROOT.format(known[0], entries[0]["url"]), "utf-8")
    (pages / ".nojekyll").touch()  # folders that begin with _ are published too


if __name__ == "__main__":
    publish(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], os.environ["GITHUB_REPOSITORY"])
