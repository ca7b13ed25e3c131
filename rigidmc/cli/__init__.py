"""The command line: rigidmc run, show, check, scenes, rerun, summary, animate, resume, status, verify, consolidate, extend, body, exact, accuracy, stress, map, plot, effects, integrators, doctor. Nothing heavy is
imported before it is needed."""

import sys

from rigidmc.cli import closed, maps, results, runs, scene, stress, study, vocabulary  # noqa: F401  (their commands, in this order)
from rigidmc.cli.common import INTERRUPTED, app


def main():
    """Entry point of the `rigidmc` command."""
    try:
        app()
    except KeyboardInterrupt:  # before or after the work itself
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
