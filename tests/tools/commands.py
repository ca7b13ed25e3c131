"""Commands of rigidmc as words: in this process, or for a process of their own."""

import os
import subprocess
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


def python(code, *words, cache=None, cwd=None, **environment):
    """(stdout, stderr) of code, or of a file of code, in a process of its own that ends well.

    cache : the folder of its disk cache; environment : variables beside those of this process,
        without those of Numba
    """
    known = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA")} | environment
    if cache is not None:
        known["RIGIDMC_CACHE_DIR"] = str(cache)
    command = [sys.executable, *(["-c", code] if isinstance(code, str) else [code]), *words]
    done = subprocess.run(command, env=known, cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr
