"""The counters of `python -m bench.house`, on a small package whose counts are known."""

import ast
import re
from pathlib import Path

import pytest

import rigidmc
from bench.tools import house_counts as counts
from bench.tools import house_imports as imports

FILES = {
    "__init__.py": '"""A package."""\n\nfrom small.ring import turn as turn\n',
    "ring.py": '''"""A module that imports another one.

It has five lines of docstring.
"""

from small.link import settled

# a comment alone
TEXT = """
# no comment, but code
"""


def turn(scene):  # not a comment alone
    """Turn."""
    return settled(scene.run.dt, scene.row.dt)
''',
    "link.py": """from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from small.ring import turn


def settled(a, b, c=1, d=2, e=3, f=4, *args, g=5, h=6, **named):
    pass


class Scene:
    pass
""",
    "parts/__init__.py": '"""The registry."""\n\nFILES = ("one", "two", "three")\n',
    "parts/one.py": "def make(row):\n    import small.parts.two\n\n    return row.dt\n",
    "parts/two.py": "import small.parts.one\n\n\ndef make():\n    pass\n",
    "parts/three.py": "from small.link import Scene\n\n\ndef turn():\n    pass\n",
    "parts/four.py": """def is_settled():
    pass


def spring():
    pass


def asked_of(scene):
    return lambda scene: 0


class Scene:
    pass
""",
}

ROOT = Path(rigidmc.__file__).parent
# rooms whose `__init__` is a guide, and not a registry of its files
GUIDED = (
    "files", "mechanics", "planning", "planning/tolerance", "results", "runs", "runs/directory",
    "scene", "scene/toml", "scene/user_parts", "studies", "views", "studies/stress",
)  # fmt: skip


def test_counters_on_a_small_package(tmp_path):
    for name, text in FILES.items():
        path = tmp_path / "small" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    sources = counts.read_sources(tmp_path / "small")

    assert imports.find_circles(sources) == ["small.link small.ring"]  # no import of a function
    assert sorted(counts.shared_names(sources)) == ["make", "turn"]
    assert counts.shared_classes(sources) == ["Scene"]
    assert counts.participles(sources) == ["asked_of", "settled"]
    assert counts.functions_of_many(sources) == ["link.py:7 settled"]
    assert counts.functions_of_scene(sources) == [
        "parts/four.py:9 asked_of",
        "parts/four.py:10 lambda",
        "ring.py:14 turn",
    ]
    assert imports.importers_of_scene(sources) == ["parts/three.py", "ring.py"]

    (ring,) = (one for one in sources if one.module == "small.ring")
    assert counts.count_lines([ring]) == (16, 6, 1, 1)  # lines, code, comments, imports


def test_no_file_imports_another_one_that_imports_it():
    """Not through others either, nor for types alone: each file can be read and imported first."""
    sources = counts.read_sources(ROOT)
    assert imports.find_circles(sources, packages=True) == []


@pytest.mark.parametrize("room", GUIDED)
def test_a_guide_names_each_file_of_its_room(room):
    guide = ast.get_docstring(ast.parse((ROOT / room / "__init__.py").read_text("utf-8")))
    files = {path.stem for path in (ROOT / room).iterdir() if path.suffix == ".py"}
    rooms = {path.name for path in (ROOT / room).iterdir() if (path / "__init__.py").is_file()}
    named = set(re.findall(r"`(\w+)`", guide))
    missing = (files | rooms) - named - {"__init__"}
    assert not missing, f"the docstring of {room}/__init__.py names none of {missing}"
