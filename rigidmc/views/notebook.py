"""Scenes and bodies as HTML, in notebooks: tables of what `rigidmc show` and `rigidmc body` say."""

import html
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigidmc.scene.body import Body
    from rigidmc.scene.scene import Scene

LABEL = 13  # characters of a line before its text


def scene_html(scene: "Scene") -> str:
    """Body, start, effects with their operations, what is conserved, steps and saves."""
    from rigidmc.views.scene import outline

    title, *lines = outline(scene)
    return _table(title, lines)


def body_html(body: "Body") -> str:
    """Mass, centre, moments about principal axes, and which rotations are stable."""
    from rigidmc.scene.quantities import is_shared
    from rigidmc.views.body import describe
    from rigidmc.views.scene import body_lines

    if not is_shared(*body.quantities()):
        return _table("a body that differs from member to member", body_lines(body))
    title, *lines = describe(body, "body")
    return _table(title, lines)


def _table(title: str, lines: list[str]) -> str:
    """Lines of a label and a text as rows; a line without label goes on with the row before."""
    rows = list[list[str]]()
    for line in lines:
        label, text = line[:LABEL].strip(), line[LABEL:]
        if line[:2] == "  " and rows:
            rows[-1][1] += f"\n{line.removeprefix(' ' * LABEL)}"
        else:
            rows.append([label, text] if line[LABEL - 1 : LABEL] == " " else ["", line])
    cell = 'style="text-align: left; vertical-align: top; white-space: pre-wrap'
    body = "".join(
        f'<tr><th {cell}">{html.escape(label)}</th>'
        f'<td {cell}; font-family: monospace">{html.escape(text)}</td></tr>'
        for label, text in rows
    )
    return f"<table><caption>{html.escape(title)}</caption>{body}</table>"


def install(shell: Any) -> None:
    """Tell the shell of a notebook how to show scenes and bodies, without importing either now."""
    formatter = shell.display_formatter.formatters["text/html"]
    formatter.for_type_by_name("rigidmc.scene.scene", "Scene", scene_html)
    formatter.for_type_by_name("rigidmc.scene.body", "Body", body_html)
