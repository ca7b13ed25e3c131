"""The check of links that ends each build of the documentation finds what is broken."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def broken(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "extensions"))
    monkeypatch.delitem(sys.modules, "links", raising=False)
    return pytest.importorskip("links").broken


PAGE = '<h1 id="top">A</h1><a name="old"></a><img src="a%20b.png"><a href="{}">x</a>'


@pytest.mark.parametrize(
    ("link", "wrong"),
    [
        ("#top", ""),
        ("#old", ""),
        ("#", ""),
        ("room/other.html?v=1#in", ""),
        ("https://elsewhere.org/page.html#at", ""),
        ("mailto:a@b.org", ""),
        ("#bottom", "index.html: #bottom: no such anchor"),
        ("room/other.html#out", "index.html: room/other.html#out: no such anchor"),
        ("room/none.html", "index.html: room/none.html: no such file"),
        ("room/", "index.html: room/: no such file"),
    ],
)
def test_a_broken_link_is_found(link, wrong, broken, tmp_path):
    (tmp_path / "room").mkdir()
    (tmp_path / "a b.png").touch()
    (tmp_path / "index.html").write_text(PAGE.format(link))
    (tmp_path / "room" / "other.html").write_text('<p id="in"><a href="../index.html#top">y</a>')
    assert broken(tmp_path) == [wrong] * bool(wrong)


def test_a_picture_that_is_missing_is_found(broken, tmp_path):
    (tmp_path / "index.html").write_text('<img src="none.png">')
    assert broken(tmp_path) == ["index.html: none.png: no such file"]


def test_every_build_checks_its_links():
    assert '"links",' in (ROOT / "docs" / "conf.py").read_text("utf-8")
