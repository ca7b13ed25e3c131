"""Pages of HTML in one file, and how they are filled."""

import html
from collections.abc import Mapping


class Page:
    """An HTML page, which a notebook shows in a frame."""

    def __init__(self, text: str) -> None:
        self.text = text

    def _repr_html_(self) -> str:
        inside = html.escape(self.text, quote=True)
        return f'<iframe srcdoc="{inside}" style="width:100%;height:780px;border:0"></iframe>'


def fill_template(text: str, parts: Mapping[str, str]) -> str:
    """Fill the places @@NAME@@ of a page."""
    # by pieces, because the inserted text may contain a placeholder
    pieces = text.split("@@")
    return "".join(parts[piece] if k % 2 else piece for k, piece in enumerate(pieces))
