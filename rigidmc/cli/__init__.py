"""The command line: a file per group of commands, listed below. Nothing heavy is imported before a
command needs it."""

import sys
from typing import Any

from rigidmc.cli import (  # noqa: F401
    accuracy,
    basins,
    body,
    directories,
    doctor,
    frequencies,
    ftle,
    maps,
    multilevel,
    new,
    rare,
    results,
    run,
    scenes,
    section,
    sensitivity,
    stress,
    vocabulary,
)
from rigidmc.cli.apart import keep_apart
from rigidmc.cli.common import FLAGGED, INCOMPLETE, INTERRUPTED, IO, OK, app
from rigidmc.cli.streams import guard


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
