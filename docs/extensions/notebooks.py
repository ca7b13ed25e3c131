"""Below the title of each page that has code, a link to the notebook that its code made."""

import re


def add_link(app, docname, source):
    """Put the link below the first title."""
    text = source[0]
    if re.match(r"---\nfile_format: mystnb\n", text):
        link = f"{{nb-download}}`Notebook of this page <{docname.rsplit('/', 1)[-1]}.ipynb>`"
        source[0] = re.sub(r"(?m)^(# .+\n)", rf"\1\n{link}\n", text, count=1)


def setup(app):
    app.connect("source-read", add_link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
