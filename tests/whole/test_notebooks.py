"""What readers download from executed pages: notebooks that Jupyter can show."""

import sys
from pathlib import Path

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
