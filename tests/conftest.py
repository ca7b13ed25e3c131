"""Settings of all tests: which run first, what hypothesis draws, one compiling process a worker."""

import os
from collections import Counter

from hypothesis import HealthCheck, settings

from rigidmc.engine import beside

# No second process compiles: the workers of pytest use all cores (4 min instead of 7).
beside.threads_available = lambda: 1

# Files that compile nothing and fail within seconds if a step or Euler's equations are wrong.
FIRST = ("tests/integrators/test_steps.py", "tests/dynamics/test_euler.py")

# Files of few tests that take 20 to 200 s: at the end one worker would wait for them.
LONG = (
    "tests/runs/test_resume.py",
    "tests/engine/test_bits.py",
    "tests/whole/test_hostile.py",
    "tests/engine/test_vectorisation.py",
    "tests/whole/test_extension.py",
    "tests/engine/test_cache.py",
    "tests/engine/test_compile_time.py",
    "tests/whole/test_random_scenes.py",
    "tests/whole/test_everywhere.py",
    "tests/engine/test_cuda.py",
    "tests/effects/test_user.py",
    "tests/integrators/test_tables.py",
    "tests/views/test_viewer.py",
)

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
    """FIRST, then LONG, then the files with the most tests, so that workers end together."""
    sizes = Counter(item.path for item in items)
    order = FIRST + LONG

    def place(item):
        name = item.path.relative_to(item.config.rootpath).as_posix()
        return order.index(name) if name in order else len(order), -sizes[item.path]

    items.sort(key=place)
