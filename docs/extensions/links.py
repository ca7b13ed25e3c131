"""Links within the built site: every file, and every anchor in a page, must be there.

Sphinx checks its own references alone, not the links and anchors of Markdown and raw HTML.
"""

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.errors import SphinxError


class Page(HTMLParser):
    """The anchors and the links of a page, and what it loads."""

    def __init__(self, text):
        super().__init__()
        self.anchors, self.links = set(), set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        for name, value in attrs:
            if name == "id" or (tag == "a" and name == "name"):
                self.anchors.add(value)
            if name in ("href", "src") and value:
                self.links.add(value)


def broken(folder):
    """What is wrong with the links of a folder of pages: one line for each."""
    folder = Path(folder).resolve()
    pages = {
        path: Page(path.read_text("utf-8"))
        for path in sorted(folder.rglob("*.html"))
        if "_static" not in path.parts  # templates of the theme
    }
    lines = []
    for path, page in pages.items():
        for link in sorted(page.links):
            scheme, host, at, _, anchor = urlsplit(link)
            if scheme or host:
                continue
            target = (path.parent / unquote(at)).resolve() if at else path
            if not target.is_file():
                lines.append(f"{path.relative_to(folder)}: {link}: no such file")
            elif target in pages and anchor and unquote(anchor) not in pages[target].anchors:
                lines.append(f"{path.relative_to(folder)}: {link}: no such anchor")
    return lines


def check(app, error):
    if error is None and app.builder.format == "html" and (lines := broken(app.outdir)):
        raise SphinxError("broken links:\n" + "\n".join(lines))


def setup(app):
    app.connect("build-finished", check, priority=900)  # after all files are there
    return {"parallel_read_safe": True, "parallel_write_safe": True}
