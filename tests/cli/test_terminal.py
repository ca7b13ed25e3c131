"""Texts of others: nothing that controls a terminal or that a spreadsheet computes; and numbers at
the ends of their range."""

import io
import os
import subprocess
import sys

import pandas as pd
import pytest

import rigidmc as rm
from rigidmc.cli.reporting import Stream
from rigidmc.errors import FileError, OptionError, SceneError, terminal_text
from rigidmc.files.reading import harmless
from rigidmc.planning.steps import make_time_grid
from rigidmc.statistics.measures import measure
from rigidmc.studies.section.points import crossing_of, period_of
from tests.tools.commands import invoke
from tests.tools.faulty import LINUX

EVIL = "\x1b]0;title\x07\x1b[2J\x9b31m\u202egnp.exe\r\x00\x7f"
BODY = "[body]\nmoments = [1.0, 2.0, 2.8]\n[start]\nomega = [0.0, 1.0, 0.1]\n"
RUN = '[run]\nintegrator = "rk4"\ndt = {}\nt_end = {}\nmembers = 4\n'


def test_controls_are_shown_as_escapes():
    safe = "\\x1b]0;title\\x07\\x1b[2J\\x9b31m\\u202egnp.exe\\r\\x00\\x7f"
    assert terminal_text(EVIL) == safe
    assert terminal_text("plain |L|², Größe\té\n") == "plain |L|², Größe\té\n"
    error = SceneError(EVIL, at=f"{EVIL}.{EVIL}", value=EVIL, nearest=EVIL, file=EVIL)
    assert str(error).isprintable()
    out = io.StringIO()
    print(EVIL, file=Stream(out))
    assert out.getvalue() == safe + "\n"


@LINUX
def test_no_command_lets_titles_control_the_terminal(tmp_path):
    """The file as a whole is from elsewhere: title, source, names and values."""
    word = '"' + "".join(f"\\u{ord(x):04x}" for x in EVIL) + '"'
    (tmp_path / "a.toml").write_text(f"title = {word}\nsource = {word}\n{BODY}{RUN.format(0.1, 1)}")
    (tmp_path / "b.toml").write_text(f"{BODY}{word} = 1\n")
    script = (
        "import sys; from rigidmc.cli import main\n"
        "for words in (['show', 'a.toml'], ['show', 'b.toml'], ['run', 'a.toml', '-o', 'a.nc'],"
        " ['summary', 'a.nc']):\n"
        "    sys.argv[1:] = words\n"
        "    try: main()\n"
        "    except SystemExit: pass\n"
        "    sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__\n"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True)
    for text in (done.stdout, done.stderr):
        assert not {0x1B, 0x07, 0x00, 0x7F, 0x0D} & {*text} and "\u202e" not in text.decode()
    assert done.stdout.count(b"\\x1b]0;title") >= 3 and b"\\x1b" in done.stderr


def test_cells_are_no_formulas(tmp_path):
    scene = rm.Scene.load("nasa_brick")
    ds = rm.simulate(scene, members=3, t_end=0.1)
    words = ["=cmd|'/C calc'!A0", " +1+1", "plain"]
    ds["note"] = ("member", pd.Series(words, dtype=object).values)
    ds["@sum"] = ("member", [1.0, -2.0, 3.0])
    ds.rigid.export(tmp_path / "a.csv")
    read = pd.read_csv(tmp_path / "a.csv")
    assert read["note"].tolist() == ["'=cmd|'/C calc'!A0", "' +1+1", "plain"]
    assert read["'@sum"].tolist() == [1.0, -2.0, 3.0]  # numbers stay numbers
    for cell in ("-x", "=x", "@x", "+x", "\t=x", "\r=x", "\uff1dx"):
        assert harmless(cell) == f"'{cell}"
    assert [harmless(x) for x in ("a=b", "", -1.0, None, "1-2")] == ["a=b", "", -1.0, None, "1-2"]


@pytest.mark.parametrize(("t_end", "dt", "every"), [
    (1.0, 5e-324, None), (1e308, 0.01, None), (1e308, 5e-324, None), (1.0, 5e-324, 0.1),
    (1e308, 1.0, 1e-308), (1.7e308, 1e-300, 1e200),
])  # fmt: skip
def test_a_number_of_steps_beyond_all_floats_is_refused(t_end, dt, every):
    with pytest.raises(SceneError, match="steps to t_end"):
        make_time_grid(t_end, dt, every)


def test_numbers_that_are_infinite_are_no_questions():
    variables = {"flips": ("member",), "omega": ("axis", "member")}
    for text in ("p(flips >= 1e999)", "mean(flips | omega[1] > 1e309)", "p(flips < -1e400)"):
        with pytest.raises(OptionError, match=r"1\.8e308"):
            measure(text, variables)
    scene = rm.Scene.load("dzhanibekov")
    with pytest.raises(OptionError, match="expected"):
        crossing_of(scene, "omega[1] = 1e999", "rises")
    with pytest.raises(OptionError, match="expected"):
        period_of(scene.effects, "every 1e999")
    with pytest.raises(OptionError, match="steps to the first point"):
        rm.section(scene, "every 1e308", members=8)


@pytest.mark.skipif(os.name == "nt", reason="paths are UTF-16")
@pytest.mark.parametrize("words", [
    ["run", "dzhanibekov", "-o", "a.nc"], ["run", "dzhanibekov", "-o", "run/"], ["summary", "b.nc"],
    ["status", "old"], ["resume", "old"], ["consolidate", "old", "-o", "c.nc"],
])  # fmt: skip
def test_a_path_that_is_not_utf_8_is_refused_before_work(words, tmp_path, monkeypatch):
    folder = os.fsencode(tmp_path) + b"/d\xff"
    try:
        os.makedirs(folder + b"/old")
    except OSError:
        pytest.skip("the file system takes UTF-8 only")
    open(folder + b"/b.nc", "wb").close()
    monkeypatch.chdir(os.fsdecode(folder))
    there = sorted(os.listdir(folder))
    done = invoke(*words)
    assert done.exit_code == 3 and "not UTF-8" in done.stderr and "nothing was done" in done.stderr
    assert sorted(os.listdir(folder)) == there
    with pytest.raises(FileError, match="not UTF-8"):
        rm.open("b.nc")
