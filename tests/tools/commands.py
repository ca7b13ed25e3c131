"""Commands of rigidmc as words: in this process, or for a process of their own."""

import sys

from typer.testing import CliRunner

from rigidmc.cli import app

COMMAND = [sys.executable, "-c", "from rigidmc.cli import main; main()"]
# the same without a second process that compiles, which takes two cores and more of both
ALONE = "from rigidmc.engine import compile_helper; compile_helper.threads_available = lambda: 1; "
ALONE_COMMAND = [*COMMAND[:2], ALONE + COMMAND[2]]


def words_of(text, *more):
    """The words of a text, which ends a word at each space, and further words as they are."""
    return [*text.split(), *map(str, more)]


def attempt(text, *more, **options):
    """The result of a command in this process, which may be a traceback; words as `words_of`."""
    return CliRunner().invoke(app, words_of(text, *more), **options)


def invoke(text, *more, **options):
    """The result of a command in this process; an error that is not reported is raised."""
    done = attempt(text, *more, **options)
    if not isinstance(done.exception, SystemExit | None):
        raise done.exception
    return done
