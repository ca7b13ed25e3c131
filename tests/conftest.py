"""Settings of all tests: which run first, what hypothesis draws, one compiling process a worker."""

import functools
import gc
import json
import os
from collections import Counter
from pathlib import Path

import pytest
import typer.main
import typer.testing
from hypothesis import HealthCheck, settings

from rigidmc.engine import compile_helper
from rigidmc.engine.compiler import machine_code

# No second process compiles: the workers of pytest use all cores (4 min instead of 7).
compile_helper.threads_available = lambda: 1


def _lowered(*given, lower=machine_code.lower):
    """The code of a piece. What Numba keeps of it is looked through for garbage once and never
    again: 1.8 s and not 3.1 of the 33 s that tests/physics/effects/test_user.py takes."""
    result = lower(*given)
    gc.collect(0)
    gc.freeze()
    return result


machine_code.lower = _lowered

# `CliRunner` makes all commands anew in each call, 25 of the 50 ms that `rigidmc show` takes.
typer.testing._get_command = functools.cache(typer.main.get_command)

# Files that compile nothing and fail within seconds if a step or Euler's equations are wrong.
FIRST = ("tests/physics/integrators/test_steps.py", "tests/physics/dynamics/test_euler.py")

# {file: seconds of a processor}: the longest run first, else one worker would wait for them at the
# end. `RECORD_DURATIONS=1 pytest` measures them anew.
DURATIONS = Path(__file__).parent / "tools" / "durations.json"
measured: Counter[str] = Counter()

# The same examples every time; HYPOTHESIS_PROFILE=nightly draws many more, and new ones.
settings.register_profile("reproducible", derandomize=True, deadline=None)
settings.register_profile(
    "nightly",
    max_examples=10_000,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "reproducible"))


def pytest_collection_finish():
    """Let no search for garbage look through tests and modules: it took 5 % of the processor."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 100)


def pytest_runtest_logreport(report):
    """Add up the seconds of each file; workers send their reports to the process that writes."""
    measured[report.nodeid.partition("::")[0]] += report.duration


def pytest_sessionfinish(session):
    """Write the files that take 5 s or more, where it is asked for."""
    if "RECORD_DURATIONS" in os.environ and not hasattr(session.config, "workerinput"):
        long = {name: round(s) for name, s in measured.most_common() if s >= 5.0}
        DURATIONS.write_text(json.dumps(long, indent=1) + "\n", "utf-8")


def pytest_collection_modifyitems(items):
    """FIRST, then the longest, then those with the most tests, so that workers end together."""
    sizes, known = Counter(item.path for item in items), json.loads(DURATIONS.read_text("utf-8"))

    def place(item):
        name = item.path.relative_to(item.config.rootpath).as_posix()
        return name not in FIRST, -known.get(name, 0), -sizes[item.path]

    items.sort(key=place)
    # Tests of limits, sick starts and random scenes flag members on purpose. The warning itself is
    # tested by pytest.warns, to which this does not apply.
    flagged = pytest.mark.filterwarnings(
        "ignore:.* flagged .* keeps? the last good state:rigidmc.errors.SceneWarning"
    )
    for item in items:
        item.add_marker(flagged)
