"""The command line: options in, text and exit codes out.

A command reads its options, calls one function of a lower room inside `with report_errors():`, and
prints the return value; it computes nothing itself. `report_errors` turns every error into one
message and an exit code. Reading order: `commands` (the table of commands), `app` (exit codes,
opening scenes and results), `reporting` (errors, signals, written files, streams), `options`
(shared options), then one file for each group of commands.

Scripts rely on help pages, messages and exit codes: a change of these needs a line in the
changelog. The file of a command is imported when the command is used, and imports heavy libraries
inside its functions.
"""

import gc
import sys
from typing import Any

from rigidmc.cli import commands  # noqa: F401  # gives the app its commands
from rigidmc.cli.app import (
    FLAGGED,
    INCOMPLETE,
    INTERRUPTED,
    IO,
    OK,
    app,
    keep_apart,
    limit_from_start,
)
from rigidmc.cli.reporting import guard


def main() -> None:
    """Entry point of the `rigidmc` command."""
    out = guard()
    keep_apart()
    limit_from_start()
    code: Any = OK
    try:
        app()
    except KeyboardInterrupt:  # before or after the main work
        code = INTERRUPTED
    except SystemExit as ended:
        code = ended.code
    out.flush()
    # a command that failed has already reported why
    if out.fault is not None and code in (None, OK, FLAGGED, INCOMPLETE):
        rule = "all output files are complete"
        print(f"rigidmc: standard output: {out.fault.strerror}; {rule}", file=sys.stderr)
        code = IO
    # all files are closed; otherwise Python would search 140,000 objects for cycles three times as
    # it ends, 0.18 s after a run
    gc.freeze()
    sys.exit(code)


if __name__ == "__main__":
    main()
