"""The command line: options in, words and exit codes out.

A command reads its options, calls one function of a lower room inside `with reported():`, and
prints what the function returns; it computes nothing itself. Every error becomes one message and an
exit code there. Reading order: `app` (the app, exit codes, panels, scenes and results opened),
`reporting` (errors, signals, files written, streams), `options` (what commands share), then a file
for each group of commands, in the list below.

Help pages, messages and exit codes are what scripts rely on: they change only with a line in the
changelog. A command imports heavy libraries inside its function, so that `--help` loads none.
"""

import sys
from typing import Any

from rigidmc.cli import (  # noqa: F401
    body,
    directories,
    doctor,
    maps,
    new,
    results,
    run,
    scenes,
    studies,
    vocabulary,
)
from rigidmc.cli.app import FLAGGED, INCOMPLETE, INTERRUPTED, IO, OK, app, keep_apart
from rigidmc.cli.reporting import guard


def main() -> None:
    """Entry point of the `rigidmc` command."""
    out = guard()
    keep_apart()
    code: Any = OK
    try:
        app()
    except KeyboardInterrupt:  # before or after the work itself
        code = INTERRUPTED
    except SystemExit as ended:
        code = ended.code
    out.flush()
    # a command that failed has told why already
    if out.fault is not None and code in (None, OK, FLAGGED, INCOMPLETE):
        rule = "files that were written are complete"
        print(f"rigidmc: standard output: {out.fault.strerror}; {rule}", file=sys.stderr)
        code = IO
    sys.exit(code)


if __name__ == "__main__":
    main()
