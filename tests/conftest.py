"""Settings of all tests: which run first, what hypothesis draws, one compiling process a worker."""

import os
from collections import Counter

from hypothesis import HealthCheck, settings

from rigidmc.engine import beside

# No second process compiles: the workers of pytest use all cores (4 min instead of 7).
beside.threads_available = lambda: 1

# Files that compile nothing and fail within seconds if a step or Euler's equations are wrong.
FIRST = ("tests/integrators/test_steps.py", "tests/dynamics/test_euler.py")

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


def pytest_collection_modifyitems(items):
    """The files of FIRST, then the files with the most tests, so that workers end together."""
    sizes = Counter(item.path for item in items)

    def place(item):
        name = item.path.relative_to(item.config.rootpath).as_posix()
        return FIRST.index(name) if name in FIRST else len(FIRST), -sizes[item.path]

    items.sort(key=place)
