"""The command line: rigidmc run, show, warm, check, scenes, rerun, summary, animate, resume, status, verify, consolidate, extend, body, exact, accuracy, stress, map, plot, effects, integrators, doctor. Nothing heavy is
imported before it is needed."""

import sys
from typing import Any

from rigidmc.cli import body, catalogues, directories, maps, results, run, stress, vocabulary, warm  # noqa: F401
from rigidmc.cli.common import FLAGGED, INCOMPLETE, INTERRUPTED, IO, OK, app
from rigidmc.cli.streams import guard


def main():
    """Entry point of the `rigidmc` command."""
    out = guard()
    code: Any = OK
    try:
        app()
    except KeyboardInterrupt:  # before or after the work itself
        code = INTERRUPTED
    except SystemExit as ended:
        code = ended.code
    out.flush()
    if out.fault is not None and code in (None, OK, FLAGGED, INCOMPLETE):  # else there is a message
        print(
            f"rigidmc: standard output: {out.fault.strerror}; files that were written are complete",
            file=sys.stderr,
        )
        code = IO
    sys.exit(code)


if __name__ == "__main__":
    main()
