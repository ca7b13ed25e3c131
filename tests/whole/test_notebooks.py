"""What readers download from executed pages: notebooks that Jupyter can show."""

import dis
import re
import sys
from pathlib import Path
from types import CodeType

import pytest

ROOT = Path(__file__).parents[2]
PAGE = """(top)=
# A title

{nb-download}`Notebook of this page <a.ipynb>`, {nb-download}`without solutions <b.ipynb>`

See {eq}`euler`, {doc}`the units <../how_to/units>` and {doc}`tables`.

```{math}
:label: spin
a &= b
```

```{page} A top
view heavy_top --live -o top.html
```
"""
SHOWN = """# A title

See (euler), the units and tables.

$$
\\begin{aligned}
a &= b
\\end{aligned}
$$

```
rigidmc view heavy_top --live -o top.html
```
"""
CELL = re.compile(r"(?m)^```\{code-cell\}.*\n(?:^:.*\n)*([\s\S]*?)^```")
# {page: names that mean one thing, although two cells assign them}
SAME = {"docs/teaching/phone.md": {"t", "omega"}}  # the record as it is made, and as it is read


@pytest.fixture
def notebooks(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "extensions"))
    monkeypatch.delitem(sys.modules, "notebooks", raising=False)
    return pytest.importorskip("notebooks")


def test_markdown_has_nothing_that_only_sphinx_reads(notebooks):
    assert notebooks.in_jupyter(PAGE) == SHOWN


def test_exercises_have_no_solutions_and_no_outputs(notebooks):
    v4 = pytest.importorskip("nbformat").v4
    solved = v4.new_code_cell("2", metadata={"tags": ["solution", "hide-cell"]})
    asked = v4.new_code_cell("1", execution_count=1, outputs=[v4.new_output("stream", text="1")])
    whole = v4.new_notebook(cells=[v4.new_markdown_cell("How many?"), asked, solved])
    left = notebooks.without_solutions(whole)
    assert [cell.source for cell in left.cells] == ["How many?", "1"]
    assert left.cells[1].outputs == [] and asked.outputs  # of the copy alone


def assigned_and_taken(cell):
    """Names that a cell assigns, and those that it takes from other cells."""
    assigned, taken = set(), set()

    def visit(code):
        for step in dis.get_instructions(code):
            if step.opname == "STORE_NAME":
                assigned.add(step.argval)
            elif step.opname in ("LOAD_NAME", "LOAD_GLOBAL") and step.argval not in assigned:
                taken.add(step.argval)
            elif isinstance(step.argval, CodeType):
                visit(step.argval)

    visit(compile(cell, "cell", "exec"))
    return assigned, taken


def ambiguous(page):
    """Names that two cells of a page assign and a third one takes: it depends on their order."""
    names = [assigned_and_taken(cell) for cell in CELL.findall(page)]
    every = [name for assigned, _ in names for name in assigned]
    taken = set().union(*(taken for _, taken in names))
    return {name for name in taken if every.count(name) > 1}


def test_cells_may_run_in_any_order():
    cells = "```{code-cell}\na = 1\n```\n```{code-cell}\nb = a\n```\n```{code-cell}\na = 2\n```\n"
    assert ambiguous(cells) == {"a"}
    pages = [
        page
        for page in ROOT.glob("docs/**/*.md")
        if "\nfile_format: mystnb" in page.read_text("utf-8")
    ]
    assert len(pages) > 10  # 16
    for page in pages:
        name = page.relative_to(ROOT).as_posix()
        assert ambiguous(page.read_text("utf-8")) <= SAME.get(name, set()), name
