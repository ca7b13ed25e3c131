"""Commands of rigidmc that the build runs: the directives `picture` and `output`.

    ```{picture} Title
    run dzhanibekov --plot flips.png
    Lines after the command are the caption.
    ```

draws the picture in `_build/pictures` and shows it with its command; a picture that is there is not
drawn again. `{page}` shows a page of `rigidmc view` in a frame, also the same page in several
documents; `{output} integrators` shows what a command prints.
"""

import re
import shlex
import shutil
import textwrap
import time
from contextlib import chdir, contextmanager
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.util import logging
from typer.testing import CliRunner

from rigidmc.cli import app as application
from rigidmc.files.locks import lock

log = logging.getLogger(__name__)
FOLDER = Path(__file__).parent.parent / "_build" / "pictures"
COLUMNS = 78  # of code beside both side bars, at 1280 pixels


def ran(command):
    """What a command prints; RuntimeError with its message if it fails."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with chdir(FOLDER):
        done = CliRunner().invoke(application, shlex.split(command))
    if done.exit_code != 0:
        raise RuntimeError(f"rigidmc {command}: {done.output} {done.exception}")
    return done.stdout


def typed(commands):
    """Commands as they are typed, on lines of COLUMNS that end in a backslash."""
    lines = []
    for command in commands:
        line, *options = re.split(r" (?=-)", f"rigidmc {command}")
        for option in options:
            if len(line) + len(option) + 3 > COLUMNS:
                lines.append(f"{line} \\")
                line = "   "
            line = f"{line} {option}"
        lines.append(line)
    text = "\n".join(lines)
    return nodes.literal_block(text, text, language="text")


def hung(line):
    """A line of a listing within COLUMNS, wrapped below its second column."""
    name = re.match(r" +|\S+ +|", line)[0]
    indent = " " * len(name) if len(name) > 6 else ""
    return textwrap.fill(line, COLUMNS, subsequent_indent=indent, break_on_hyphens=False)


def drawn(command):
    """The path of the picture of a command, drawn if it is not there."""
    words = shlex.split(command)
    name = words[words.index("--plot" if "--plot" in words else "-o") + 1]
    if not (FOLDER / name).exists():
        log.info("drawing %s", name)
        ran(command)
    return f"/_build/pictures/{name}"


@contextmanager
def alone(name):
    """Wait while another process makes the picture or page of this name."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with open(FOLDER / f"{name}.lock", "w") as file:
        while True:
            try:
                lock(file, file.name)
                break
            except BlockingIOError:
                time.sleep(0.5)
        yield


class Picture(Directive):
    """A picture, the commands that draw it, and a caption."""

    required_arguments, final_argument_whitespace, has_content = 1, True, True

    def run(self):
        lines = list(self.content)
        count = lines.index("") if "" in lines else len(lines)
        *before, last = lines[:count]
        if not (FOLDER / shlex.split(last)[-1]).exists():
            for command in before:
                ran(command)
        figure = nodes.figure()
        figure += nodes.image(uri=drawn(last), alt=self.arguments[0])
        caption = nodes.container()
        self.state.nested_parse(StringList(lines[count:]), self.content_offset, caption)
        title = nodes.rubric(text=self.arguments[0])
        return [title, figure, *caption.children, typed(lines[:count])]


class Page(Directive):
    """A page of `rigidmc view` in a frame, and the commands that write it."""

    required_arguments, final_argument_whitespace, has_content = 1, True, True

    def run(self):
        *before, last = self.content
        name = shlex.split(last)[-1]
        with alone(name):
            if not (FOLDER / name).exists():
                for command in before:
                    ran(command)
            drawn(last)
        room = "../" * self.state.document.settings.env.docname.count("/")
        frame = (
            # as high as its page, which tells its height, also from a file
            "<script>window.framed ??= addEventListener('message', ({source, data}) => { for (const"
            " frame of document.querySelectorAll('iframe')) if (frame.contentWindow === source &&"
            " data.pageHeight) frame.style.height = data.pageHeight + 'px' }) ?? true</script>"
            f'<iframe src="{room}pages/{name}" title="{self.arguments[0]}" loading="lazy"'
            ' style="width: 100%; height: 780px; border: 1px solid #ccc"></iframe>'
            f'<p><a href="{room}pages/{name}">the page alone</a></p>'
        )
        return [nodes.raw("", frame, format="html"), typed(self.content)]


def copy_pages(app, error):
    """Put the pages into the site."""
    if error is None:
        (Path(app.outdir) / "pages").mkdir(exist_ok=True)
        for page in FOLDER.glob("*.html"):
            shutil.copy(page, Path(app.outdir) / "pages" / page.name)


class Output(Directive):
    """What a command prints."""

    required_arguments, final_argument_whitespace = 1, True

    def run(self):
        text = "\n".join(map(hung, ran(self.arguments[0]).splitlines()))
        return [nodes.literal_block(text, text, language="text", classes=["listing"])]


def setup(app):
    app.add_directive("picture", Picture)
    app.add_directive("page", Page)
    app.connect("build-finished", copy_pages)
    app.add_directive("output", Output)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
