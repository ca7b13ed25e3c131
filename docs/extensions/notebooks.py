"""Executed pages as notebooks: links below the title, and notebooks that Jupyter can show.

A page with cells of the tag `solution` has two: with all cells, and without these and all outputs.
"""

import re
from copy import deepcopy
from pathlib import Path

import nbformat
from sphinx.util import logging

log = logging.getLogger(__name__)
IS_NOTEBOOK = re.compile(r"---\nfile_format: mystnb\n")
# the lines of a scene file keep the digits that make the same bits
LONG = re.compile(r"(?m)^(?!\w+ = ).*?(\d[\d.]{11,})")
HAS_SOLUTIONS = re.compile(r"tags.*\bsolution\b")
# {what Sphinx alone can read: what Jupyter shows instead}
IN_JUPYTER = {
    r"```\{eval-rst\}\n[\s\S]*?```\n+": "",  # entries of the index
    r"\{nb-download\}.*\n+": "",
    r"(?m)^\([\w-]+\)=\n": "",  # labels
    r"```\{math\}\n(?::label: .*\n)?([\s\S]*?)```": r"$$\n\\begin{aligned}\n\1\\end{aligned}\n$$",
    r"```\{page\}.*\n([\s\S]*?)```": r"```\nrigidmc \1```",
    r"\{eq\}`([^`]*)`": r"(\1)",
    r"\{[\w:]+\}`([^`<]*?)(?: <[^`]*>)?`": r"\1",
}


def add_links(app, docname, source):
    """Put the links below the first title of a page that is executed."""
    if IS_NOTEBOOK.match(source[0]):
        name = docname.rsplit("/", 1)[-1]
        links = f"{{nb-download}}`Notebook of this page <{name}.ipynb>`"
        if HAS_SOLUTIONS.search(source[0]):
            links += f", {{nb-download}}`without solutions <{name}_without_solutions.ipynb>`"
        source[0] = re.sub(r"(?m)^(# .+\n)", rf"\1\n{links}\n", source[0], count=1)


def in_jupyter(text):
    """Markdown of a page, as Jupyter can show it."""
    for pattern, shown in IN_JUPYTER.items():
        text = re.sub(pattern, shown, text)
    return text


def is_solution(cell):
    """Whether a cell has the tag `solution`."""
    return "solution" in cell.metadata.get("tags", ())


def without_solutions(notebook):
    """A notebook without its solutions, and with nothing computed."""
    left = deepcopy(notebook)
    left.cells = [cell for cell in left.cells if not is_solution(cell)]
    for cell in left.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    return left


def long_numbers(notebook):
    """Numbers of more than eleven digits in the text that cells show, one for each line."""
    found = []
    for output in (o for cell in notebook.cells for o in cell.get("outputs", ())):
        shown = output.get("data", {"text/plain": output.get("text", "")})
        if "text/html" not in shown:
            found += LONG.findall(shown.get("text/plain", ""))
    return found


def convert(app, doctree):
    """Make the notebooks that the links of a page offer."""
    path = Path(app.env.mystnb_config.output_folder, f"{app.env.docname}.ipynb")
    if not path.is_file():
        return
    notebook = nbformat.read(path, 4)
    for number in long_numbers(notebook):
        log.warning("%s: a cell prints %s; round it", app.env.docname, number)
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = in_jupyter(cell.source)
    nbformat.write(notebook, path)
    if any(map(is_solution, notebook.cells)):
        bare = path.with_stem(f"{path.stem}_without_solutions")
        nbformat.write(without_solutions(notebook), bare)


def setup(app):
    app.connect("source-read", add_links)
    app.connect("doctree-read", convert, priority=400)  # before Sphinx collects what links offer
    return {"parallel_read_safe": True, "parallel_write_safe": True}
