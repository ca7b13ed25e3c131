"""Whatever a body file contains, `rigidmc body` reads or refuses it, in 5 s and 1 GB.

Files of all readers, mutated in bytes, words and structure: many roots, cycles, long chains, deep
elements, encodings, entities, long blanks, claims of size, holes, pipes. Time and memory are those
of the process and of its helper. 10,000 files with `pytest -n 0 -s -m slow
tests/scene/body_files/test_hostile_bodies.py`, which prints the worst.
"""

import collections
import encodings.aliases
import os
import random
import re
import shutil
import struct

import numpy as np
import psutil
import pytest

from rigidmc.files import trial
from rigidmc.scene.body_files import SUFFIXES
from tests.scene.body_files.test_cad_text import particles, solidworks
from tests.scene.body_files.test_robots import joint, link, mjcf, robot
from tests.tools.commands import invoke
from tests.tools.faulty import LINUX
from tests.tools.hostile import NUMBERS, bytes_of, hostile_kind
from tests.tools.hostile_readers import MESHES, hostile_mesh

pytestmark = LINUX

SECONDS, MEGABYTES = 5.0, 1000.0
CODES = {0, 3, 74}
INERTIAL = '<inertial mass="1" pos="0 0 0.1" diaginertia="1 1 1.5"/>'
GOOD = {
    ".urdf": robot(*map(link, "abc"), joint("a", "b"), joint("b", "c", kind="revolute")),
    ".xml": mjcf(
        f'<body name="a">{INERTIAL}<frame euler="0 9 0"><body name="b" quat="1 1 0 0">{INERTIAL}'
        f'</body></frame></body><body name="c" pos="1 0 0"><joint/>{INERTIAL}</body>',
        '<compiler angle="radian" eulerseq="xyz"/>',
    ),
    ".txt": solidworks(*particles()),
}
CODECS = sorted({*encodings.aliases.aliases.values(), "undefined", "idna", "foo", "../x"})
PIECES = (
    "", " " * 30_000, "\n" * 2000, "(" * 30_000, "9" * 5000, "1e999", "nan", "-0", "1_0", "\0",
    "\ufffe", "&a;", "<!--", "<![CDATA[", "<?x ?>", '<!DOCTYPE r [<!ENTITY a "b">]>', "${x}",
    "xacro:", "Lxx = 1 g mm^2 ", "Px = 1 " * 4000, "mass = 1 ^", "2", "²", "Taken (", "= " * 20_000,
)  # fmt: skip


def large(some, ending):
    """A text with many of something that a good one has once."""
    n, e = some.choice((30, 2000, 8000)), "<link name='{}'/>"
    if ending == ".urdf":
        chain = [joint(f"l{i}", f"l{i + 1}") for i in range(n - 1)]
        links = [e.format(f"l{i}") for i in range(n)]
        roots = [e.format(f"r{i}") for i in range(n // 4)]
        more = some.choice(
            (
                [joint(f"r{i}", "l0") for i in range(n // 4)],
                [joint(f"l{n - 1}", f"r{i}") for i in range(n // 4)],
                [joint(f"l{n - 1}", f"l{some.randrange(n)}")],
                [link(f"m{i}", mass=some.choice((0, 1, -1))) for i in range(n // 8)],
                [],
            )
        )
        return robot(*some.sample(links, n), link("end"), *roots, *chain, *more)
    if ending == ".xml":
        inside = some.choice(
            (
                "<body>" * (n // 40) + INERTIAL + "</body>" * (n // 40),
                "<frame>" * (n // 40) + "<body>" + INERTIAL + "</body>" + "</frame>" * (n // 40),
                f"<body name='a'>{f'<body>{INERTIAL}</body>' * n}</body>",
                f"<body>{INERTIAL.replace('1.5', '5')}</body>" * n,
                f"<frame><body>{INERTIAL}</body></frame>" * n,
            )
        )
        return mjcf(inside, "<compiler/>" * some.choice((0, n)))
    lines = GOOD[ending].split("\n")
    at = some.randrange(len(lines))
    return "\n".join(lines[:at] + lines[at : at + 1] * n + lines[at:])


def hostile_text(some, ending):
    text, what = GOOD[ending], some.choice(("bytes", "piece", "number", "large", "gone", "head"))
    if what == "bytes":
        return bytes_of(some, text.encode())
    if what == "number":
        words = re.split(r"([-+\d.e]+)", text)
        for _ in range(some.choice((1, 2, 5))):
            words[2 * some.randrange(len(words) // 2) + 1] = str(some.choice((*NUMBERS, 10**40)))
        return "".join(words).encode()
    if what == "head":
        if some.random() < 0.3:
            return text.encode(some.choice(("utf-16", "utf-32", "utf-8-sig", "cp500")))
        return f'<?xml version="1.0" encoding="{some.choice(CODECS)}"?>{text}'.encode()
    if what == "large":
        text = large(some, ending)
    for _ in range(some.choice((1, 1, 3))):
        at = some.randrange(len(text) + 1)
        end = at + some.choice((0, 5, 60)) * (what != "large")
        piece = text[end : end + some.choice((20, 300))] if what == "gone" else some.choice(PIECES)
        text = text[:at] + piece * (what != "large" or some.random() < 0.3) + text[end:]
    return text.encode("utf-8", "surrogatepass")


def claim(some, path):
    """Write a mesh that claims more than it has, or a dense one with nothing in it."""
    n = some.choice((10**3, 10**5, 4 * 10**6, 2**31, 2**32 - 1))
    head = bytes(80) + struct.pack("<I", n)
    if not path.endswith(".stl"):
        head = MESHES[path[-4:]].replace("4", str(n), some.choice((1, 2))).encode()
    with open(path, "wb") as file:
        file.write(head)
        if some.random() < 0.5:
            file.truncate(min(len(head) + 50 * n, 2**33))
        else:
            file.write(some.choice((b"\0", b"1 ", b"\n", b"f 1 2 3\n")) * some.choice((100, 10**5)))


def hostile_body(some, folder):
    ending = some.choice((*GOOD, *GOOD, *MESHES))
    path = os.path.join(folder, f"hostile{ending}")
    if ending in GOOD:
        with open(path, "wb") as file:
            file.write(hostile_text(some, ending))
        if some.random() < 0.02:
            hostile_kind(some, path)
    elif some.random() < 0.3:
        claim(some, path)
    else:
        path = hostile_mesh(some, None, folder)
    return path


def kilobytes(process, word):
    with open(f"/proc/{process.pid}/status") as file:
        return int(re.search(rf"{word}:\s*(\d+)", file.read())[1])


class Meter:
    """CPU seconds of this process and its children, and megabytes that they take more."""

    def __init__(self):
        self.me = psutil.Process()

    def _tree(self):
        return [self.me, *self.me.children(recursive=True)]

    def begin(self):
        for one in self._tree():
            with open(f"/proc/{one.pid}/clear_refs", "w") as file:
                file.write("5")  # the peak of its memory counts from here
        self.before = {one.pid: sum(one.cpu_times()[:2]) for one in self._tree()}
        self.kept = {one.pid: kilobytes(one, "VmRSS") for one in self._tree()}
        self.ended = sum(self.me.cpu_times()[2:4])

    def end(self):
        seconds, size = sum(self.me.cpu_times()[2:4]) - self.ended, 0
        for one in self._tree():
            size += kilobytes(one, "VmHWM") - self.kept.get(one.pid, 0)
            seconds += sum(one.cpu_times()[:2]) - self.before.get(one.pid, 0.0)
        return seconds, size / 1024


def attack(count, seed, folder):
    """Read `count` hostile files; return (how they ended, worst seconds, worst MB)."""
    ends, worst, most = collections.Counter(), (0.0, ""), (0.0, "")
    meter, names = Meter(), os.path.join(folder, "files")
    for i in range(count):
        some = random.Random(f"{seed} {i}")
        os.mkdir(names)
        path = hostile_body(some, names)
        words = ["body", path]
        if path[-4:] in MESHES:
            words += ["--density", "1000", "--solid", some.choice(("solid", "hull"))]
        meter.begin()
        done = invoke(*words)
        seconds, size = meter.end()
        failed = not isinstance(done.exception, (SystemExit, type(None)))
        assert not failed and done.exit_code in CODES, (seed, i, path, done.exception, done.output)
        assert "Traceback" not in done.output and len(done.output) < 20_000, (seed, i, path)
        assert seconds < SECONDS and size < MEGABYTES, (seed, i, path, seconds, size)
        ends[path[-4:], done.exit_code] += 1
        name = f"{i} {path[-4:]}"
        worst, most = max(worst, (seconds, name)), max(most, (size, name))
        shutil.rmtree(names)
    return ends, worst, most


@pytest.fixture(scope="module", autouse=True)
def warm(tmp_path_factory):
    """Import what takes seconds, and start the helper."""
    path = tmp_path_factory.mktemp("warm") / "good.stl"
    path.write_text(MESHES[".stl"])
    assert invoke("body", path, "--density", "1000").exit_code == 0
    for ending, text in GOOD.items():
        path = path.with_suffix(ending)
        path.write_text(text)
        invoke("body", path)
    assert trial._idle


def test_every_format_has_a_file_to_damage():
    read_as_others = {".mjcf", ".xacro"}  # as .xml and .urdf
    assert {*SUFFIXES} - read_as_others == {*GOOD, *MESHES}, "add a good file to GOOD"


def test_hostile_bodies_are_read_or_refused(tmp_path):
    ends, *_ = attack(60, 1, tmp_path)
    assert {code for _, code in ends} >= {0, 3}


@pytest.mark.slow
def test_ten_thousand_hostile_bodies(tmp_path):
    ends, worst, most = attack(int(os.environ.get("COUNT", 10_000)), 2, tmp_path)
    print(sorted(ends.items()), worst, most)
    assert np.sum(list(ends.values())) > 0
