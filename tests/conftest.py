"""Settings of all tests: hypothesis draws the same examples every time, or with HYPOTHESIS_PROFILE=nightly many more and new ones."""

import os

from hypothesis import HealthCheck, settings

from rigidmc.engine import beside

beside.threads_available = lambda: (
    1
)  # no second process to compile: the workers of pytest take all cores (4 min in place of 7)

settings.register_profile("reproducible", derandomize=True, deadline=None)
settings.register_profile(
    "nightly",
    max_examples=10_000,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "reproducible"))
