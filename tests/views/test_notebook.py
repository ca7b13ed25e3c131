"""Scenes, bodies and results in notebooks."""

import subprocess
import sys

import pytest
from IPython.core.formatters import DisplayFormatter
from matplotlib.figure import Figure

import rigidmc as rm
from rigidmc.processes import progress
from rigidmc.views.accessor import body_html, scene_html
from rigidmc.views.figures import new_figure


def test_a_scene_tells_body_start_effects_with_price_and_settings():
    text = scene_html(rm.Scene.load("heavy_top"))
    for words in ("heavy_top", "moments", "normal(200, 5)", "gravity(g = 9.81)", "operations"):
        assert words in text
    for label in ("body", "start", "conserved", "steps", "saves", "members", "price"):
        assert f">{label}</th>" in text
    assert "auto" not in scene_html(rm.Scene.load("heavy_top").with_run(tolerance=1e-6))


def test_a_body_tells_moments_and_which_rotations_are_stable():
    text = body_html(rm.Body.box(1.0, (1.0, 0.5, 0.2)))
    assert "unstable about axis 2" in text and ">principal</th>" in text and "smallest" in text
    assert "<b>" not in body_html(rm.Body((rm.normal(1.0, 0.1), 1.5, 2.0)))
    assert "normal(1, 0.1)" in body_html(rm.Body((rm.normal(1.0, 0.1), 1.5, 2.0)))


def test_titles_are_text_and_no_markup():
    scene = rm.Scene(rm.Body.box(1.0, (1, 2, 3)), start=rm.Start(omega=(0, 0, 1)), title="<b>")
    assert "&lt;b&gt;" in scene_html(scene) and "<b>" not in scene_html(scene)


def test_a_result_tells_its_summary():
    ds = rm.simulate(rm.Scene.load("dzhanibekov"), members=4, t_end=1.0, every=0.5)
    assert ds.rigid._repr_html_().startswith("<pre>dzhanibekov: 4 members")


def test_a_shell_shows_scenes_without_importing_them_first():
    pytest.importorskip("IPython")
    code = (
        "from IPython.core.interactiveshell import InteractiveShell as S; s = S.instance();"
        " import rigidmc as rm, sys; print('rigidmc.scene.scene' in sys.modules);"
        " show = s.display_formatter.format;"
        " print('<table>' in show(rm.Scene.load('dzhanibekov'))[0]['text/html']);"
        " print('<table>' in show(rm.Body.box(1.0, (1, 2, 3)))[0]['text/html'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.split() == ["False", "True", "True"], done.stderr


def test_progress_in_a_notebook_is_a_bar(monkeypatch):
    display = pytest.importorskip("IPython.display")
    shown = []

    class Place:
        def update(self, html):
            shown.append(html.data)

    monkeypatch.setattr(display, "display", lambda *_, **__: Place())
    monkeypatch.setattr(progress, "in_notebook", lambda: True)
    rm.simulate(rm.Scene.load("dzhanibekov"), members=64, t_end=1.0, every=0.5, progress=True)
    assert shown[-1].startswith('<progress value="6400" max="6400">') and "100 %" in shown[-1]


def test_a_picture_is_shown_where_nothing_imported_pyplot():
    """IPython shows a plain Figure as its name until pyplot has told it how."""
    shown, _ = DisplayFormatter().format(new_figure("a picture", (2.0, 1.0)))
    assert shown["image/png"].startswith(b"\x89PNG")
    plain, _ = DisplayFormatter().format(Figure())
    assert "image/png" not in plain
