"""What readers download from executed pages: notebooks that Jupyter can show."""

import dis
import re
import sys
from pathlib import Path
from types import CodeType

import numpy as np
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


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("turns:\n1.3004957461220616\n", ["1.3004957461220616"]),
        ("0.400001, 1,234,567.891 and -1.23456789e-10", []),
        ("omega = [0.0, 6.283185307179586]", []),  # of a scene file
    ],
)
def test_long_numbers_are_found(text, found, notebooks):
    v4 = pytest.importorskip("nbformat").v4
    shown = v4.new_output("execute_result", data={"text/plain": text})
    for output in (v4.new_output("stream", text=text), shown):
        page = v4.new_notebook(cells=[v4.new_code_cell("1", outputs=[output])])
        assert notebooks.long_numbers(page) == found
    shown.data["text/html"] = "a dataset"
    assert notebooks.long_numbers(page) == []


def defined(page, name):
    """The names that the cell with a function defines."""
    text = (ROOT / "docs" / "teaching" / f"{page}.md").read_text("utf-8")
    cells = re.findall(r"```\{code-cell\} ipython3\n(.*?)```", text, re.S)
    (cell,) = (cell for cell in cells if f"def {name}(" in cell)
    return cell


@pytest.mark.parametrize(
    ("given", "true", "shown"),
    [
        (93.54142, 93.5414, "93.54142 instead of 93.5414"),
        (4.00000001, 4.0, "4.00000001 instead of 4"),
        (1.0 + 2.0**-52, 1.0, "1.0000000000000002 instead of 1"),
        (-0.5, 0.5, "-0.5 instead of 0.5"),
    ],
)
def test_the_checker_shows_where_an_answer_differs(given, true, shown, capsys):
    names = {}
    exec(defined("exercises", "check"), names)
    assert names["difference"](given, true) == shown
    names["check"](lambda: [1.0, given], lambda: [1.0, true], ())
    printed = capsys.readouterr().out
    assert shown in printed or "is right" in printed  # within 1e-9 of the truth


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (4.0, "is right in 1 case\n"),
        (4.0 + 1e-12j, "returns (4+1e-12j); expected one number"),
        ("4", "returns '4'; expected one number"),
        (None, "returns None; expected one number"),
        ([4.0, [1.0, 2.0]], "expected one number"),
    ],
)
def test_the_checker_takes_numbers_alone(given, said, capsys):
    names = {"np": np}
    exec(defined("exercises", "check"), names)
    names["check"](lambda x: given, lambda x: x, (4.0,))
    assert said in capsys.readouterr().out
    names["check"](abs, abs)
    assert capsys.readouterr().out == "give cases to compare\n"


@pytest.mark.parametrize("sep", [";", "\t", ","])
@pytest.mark.parametrize("decimal", [",", "."])
def test_the_lab_sheet_reads_records_of_all_countries(sep, decimal, tmp_path):
    pytest.importorskip("pandas")
    names = {}
    columns = re.search(r"^COLUMNS = .*$", defined("phone", "thrown"), re.M).group()
    reader = defined("phone", "read").split("\n\n\n")[0]
    exec(f"import pandas as pd\n{columns}\n{reader}", names)
    rows = [["0.0", "0.001", "-2.5", "3.0"], ["0.01", "1.25", "-2.625", "3.5"]]
    lines = [[f'"{name}"' for name in names["COLUMNS"]]]
    lines += [[x.replace(".", decimal) for x in row] for row in rows]
    (tmp_path / "throw.csv").write_text("\n".join(sep.join(line) for line in lines))
    if sep == decimal:
        with pytest.raises(ValueError, match="are there decimal commas"):
            names["read"](tmp_path / "throw.csv")
        return
    t, omega = names["read"](tmp_path / "throw.csv")
    assert t.tolist() == [0.0, 0.01]
    assert omega.tolist() == [[1e-3, -2.5, 3.0], [1.25, -2.625, 3.5]]
    (tmp_path / "throw.csv").write_text("\n".join(sep.join(line) for line in (lines[0], ["x"] * 4)))
    with pytest.raises(ValueError, match="has values such as 'x', not numbers"):
        names["read"](tmp_path / "throw.csv")


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
