"""How commands end: the one table of exit codes. The help and docs/reference/commands.md show it,
and tests/cli/test_codes.py holds every command to it."""

OK, USAGE, INVALID, FLAGGED, INCOMPLETE, REFUSED = 0, 2, 3, 4, 5, 6
IO, INTERRUPTED, TERMINATED = 74, 130, 143

# {code: (in a few words, when)}
CODES = {
    OK: ("done", "the command did its work, and no member is flagged"),
    USAGE: ("usage", "no such command or option, or an argument is missing"),
    INVALID: (
        "invalid",
        "what was given cannot be used: a scene, a value of an option, a member or a measure that"
        " a result does not have, a file that is damaged or of another kind, a run that `verify`"
        " finds wrong",
    ),
    FLAGGED: ("flagged", "done, and some members are flagged; of `stress`, `doctor`: some fail"),
    INCOMPLETE: ("incomplete", "members, shards or accuracy are still missing"),
    REFUSED: ("refused", "something exists in the place of an output; nothing was overwritten"),
    IO: (
        "input or output",
        "a scene, result or run directory is not there, or cannot be read or written; memory, disk,"
        " a graphics processor or an optional package is missing",
    ),
    INTERRUPTED: ("interrupted", "by Ctrl-C"),
    TERMINATED: ("terminated", "by SIGTERM"),
}


def in_short() -> str:
    """The codes on a line of help."""
    return f"Exit codes: {', '.join(f'{code} {words}' for code, (words, _) in CODES.items())}."


def table() -> str:
    """The codes as a Markdown table."""
    rows = [f"| {code} | {words}: {when} |" for code, (words, when) in CODES.items()]
    return "\n".join(["| code | meaning |", "| ---: | --- |", *rows])
